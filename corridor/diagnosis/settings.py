"""Every number by which a diagnosis decides, with its unit and where it comes from.

`SOURCES` says where each comes from. A diagnosis takes them as its argument
`settings` and writes them into diagnosis.json; `SETTINGS` reads those in use, and `changed` puts
others in their place for a while, to see what a verdict owes to one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from dataclasses import dataclass, replace
from math import log
from typing import Any


@dataclass(frozen=True)
class Settings:
    """Sizes of effects are in prior standard deviations, evidence in natural logarithms."""

    # --- reference model and image noise
    # Degrees of freedom of Student's t; Cauchy's weights of its square root have them.
    student_nu: float = 4.0
    # Prior sigma of an adjusted effect that could stand in for the camera, and size up to which
    # one may go to imitate another.
    prior_of_adjusted: float = 10.0
    # Flights without GNSS worth the name take 71 to 83 (special_plot, brighton). Shapes
    # with a hundred parameters creep to their end, and need not reach it (the cost of special_plot
    # falls by 0.3 % in the last of six; that of garfield, far from its start, by 17 % and more).
    # Beyond half of them (garfield's 134 to 200) the believed model has bent the block to its
    # errors: a turn of 164 ms fitted from there comes to 130 ms, at a higher cost. After a fifth it
    # is asked whether only weights creep on: five gain less than this share of the cost.
    iterations: int = 200
    settled: float = 1e-4
    iterations_of_shapes: int = 6
    creeping: float = 0.05
    # Least share of redundancy that few rays leave.
    least_redundancy: float = 0.05
    # Measurements that the stated sigma of marks is worth: few do not tell their own size.
    stated_mark_weight: float = 50.0
    # Cauchy's width at which marks are weighed.
    mark_cauchy_width: float = 3.0

    # --- evidence
    # Sizes over which an effect is averaged, and how likely each is. The last ones are a tail: an
    # effect a hundred times larger than expected is still one. Tuned on simulated blocks.
    effect_sizes: tuple[float, ...] = (0.1, 0.33, 1.0, 3.0, 10.0, 100.0, 1000.0)
    effect_size_weights: tuple[float, ...] = (0.25, 0.25, 0.25, 0.23, 0.018, 0.0018, 0.0002)
    # Least size at which a fit is judged.
    least_fit_size: float = 3.0
    # Information below which a direction is one that nothing determines.
    blind_information: float = 1e-4
    # Log prior of a generic shape, of values per image, and of errors of the ground, which defines
    # the coordinates people want: where GNSS and control disagree it is rather the GNSS. Tuned.
    log_prior_generic: float = -4.0
    log_prior_per_image: float = -1.0
    log_prior_ground: float = -0.7

    # --- chances
    # Of an alarm of two halves, or of noise that changes, in a sound block.
    alarm_level: float = 0.01
    # Of what is suspected, of a gain in predictions that is none, of check points that contradict
    # what is true: one in twenty.
    doubt_level: float = 0.05
    # Numbers that tell their own size: rays of a point of which one is held out, strips of which
    # each is asked with the others' value, antenna positions; images.
    fewest: int = 4
    fewest_images: int = 6

    # --- clusters of residuals
    # Images of a run, and places of the picture (columns, rows) whose residuals hang together;
    # where something lies is told by cells of half their side.
    run_of_images: int = 10
    places: tuple[int, int] = (8, 6)
    # Clusters that the prior knowledge, which is that residuals are independent, is worth.
    clusters_of_prior: float = 10.0
    # Draws of independent noise that say how much of it residuals of a cluster keep.
    cluster_draws: int = 3

    # --- lens
    # Sizes of what polynomials leave of it, among which the data choose: 0.2 to 0.3 px, 0.4 to 0.6
    # of these, in the survey of Saraburi.
    lens_sizes: tuple[float, ...] = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0)

    # --- ground control
    # Chance of calling a point of a block without any blunder wrong, or matches of a sound one.
    control_level: float = 0.002
    # Share of the control points of a survey that are wrong.
    wrong_control: float = 0.02

    # --- thresholds
    null_draws: int = 1000
    # Noise is never quite what its model says: no block is accused below these. What is judged
    # beside noise of any size and slowness has paid for some of that already, and is held against
    # `model_log_odds`. Tuned.
    named_least: float = 4.0
    suspected_least: float = 2.5

    # --- search
    most_refits: int = 3
    most_groups: int = 6
    # Share of the largest evidence below which a group is what its linearisation left, as long as
    # that one has not been adjusted; then, what its physics are too simple for. Tuned.
    leftover_share: float = 0.02
    leftover_share_adjusted: float = 0.002
    # Evidence from which on an effect shows through any noise of the GNSS.
    clear_evidence: float = 40.0
    # Share of the fit of a shape with which a named effect takes its place, where it is behind by
    # no more than the log odds of look-alikes or this share of its evidence. Residuals of real
    # flights hang together: in Saraburi a shape of 15 parameters beat the true drift by 2 to 6.
    named_share_of_shape: float = 0.6
    shape_advantage: float = 0.15
    # Log odds by which another model has to be better to take the place of one.
    model_log_odds: float = 3.0
    # Parameters of a group that are few enough to be left free, and the size they are given.
    most_free: int = 30
    free_size: float = 1e3
    # A named effect with less than `same_fit_share` of a generic one's evidence, in the same kind
    # of measurements, is what a wrong model leaves; one of this size beside it is two shapes that
    # nearly cancel, and no cause. Beyond it no effect is looked for. Tuned.
    implausible_size: float = 100.0
    # Standard deviations by which an effect has to be larger than it can be, to be ruled out.
    implausible_sigma: float = 2.0
    # Images from which on earlier rounds keep no matrices.
    large_block: int = 400

    # --- GNSS noise: white, and exponentially correlated (Gauss-Markov)
    # Log-normal priors: median of the factor on the stated sigma (time constant: s), log sigma of
    # what all flights and axes share (one receiver), and of each by itself. They keep short
    # flights sensible, and a bias of one axis from passing for noise that others do not show.
    white_prior: tuple[float, float, float] = (0.7, 0.5, 0.35)
    slow_prior: tuple[float, float, float] = (0.6, 0.35, 0.35)
    time_constant_prior: tuple[float, float, float] = (60.0, 0.4, 0.4)
    noise_factor_range: tuple[float, float] = (0.03, 30.0)
    time_constant_range: tuple[float, float] = (4.0, 240.0)
    # Stated sigma or scatter in plan, m, up to which positions are fixed carrier-phase solutions: a
    # tenth of what code gives. Their slow part at most, m: twice the RMS that makers of receivers
    # state (1 cm + 1 ppm in plan, 1.5 cm + 1 ppm in height), or what is stated where positions
    # scatter by that much. It is correlated over 115 s (Miller, O'Keefe and Gao 2012, phase of L1
    # on baselines up to 10 km).
    carrier_phase_plan: float = 0.15
    carrier_phase_slow: tuple[float, float, float] = (0.02, 0.02, 0.03)
    # Their white part at most, in how much one residual differs from the next: poses follow some.
    white_of_scatter: float = 3.0
    # Noises that an effect's uncertainty is averaged over.
    noise_draws: int = 16
    # Seconds between images where no times are known.
    untimed_step: float = 2.0
    # Share of what a group explains that the antenna positions see, from which on its evidence is
    # held against noise of the GNSS; from which on it is a matter of the GNSS.
    gnss_share: float = 0.01
    gnss_share_main: float = 0.3

    # --- verdict
    # How many more parameters an explanation of the same may have.
    look_alike_more_parameters: int = 3
    # Share of a fit below which something else is no explanation of the same; of evidence, with a
    # shape and without, below which the two have to do with each other; of the largest deformation
    # from which on it belongs to the place.
    same_fit_share: float = 0.5
    # Share of a generic group's evidence from which on a named effect is a part of it; and of what
    # turns during a readout show by rows, from which on columns that show it too deny them.
    overlap_share: float = 0.1
    # Standard deviations at which an effect is seen nearly always, and from which on a match has
    # next to no say in the fit.
    detection_sigma: float = 4.5

    # --- held-out data
    # Parts of the places of each picture that are left out in turn, or the first of them alone.
    folds: int = 7
    # Fewest tie observations of which some can be spared, or whose noise can be asked.
    fewest_ties: int = 200
    # Check points that are asked, where there are more.
    most_asked_points: int = 60
    # Check points from which on they decide, and the ratio of their errors that is more than
    # chance: they are few, and each shift of the datum moves them.
    enough_checks: int = 3
    clear_ratio_checks: float = 0.8
    # Rivals, shapes and parts that are asked or told.
    most_rivals: int = 4

    # A shape of the picture is worth a word where it moves the ground by `implausible_sigma` of its
    # sigmas, or takes the error of data that no fit has used below this share.
    cost_ratio: float = 0.95

    # --- wrong matches
    # Lines of the picture that are tried along its longer side.
    lines: int = 512
    # Times the usual share (corners of real pictures have twice as much).
    cluster_ratio: float = 3.0

    # --- changes of the image noise
    # Ratio of the standard deviations at both ends: the noise that points with few rays leave is
    # known no better. Of a vibration: a fiftieth of the variance that rows read together share.
    variance_ratio: float = 1.25
    vibration_ratio: float = 1.01

    @property
    def look_alike_log_odds(self) -> float:
        """Log odds within which two explanations are equally good: a hundred, as of the level."""
        return -log(self.alarm_level)


# Where the numbers come from: names by source. The page of settings in the documentation has them.
SOURCES = {
    "Heavy tails of matches: Student's t, and Cauchy's weights that go with it": (
        "student_nu mark_cauchy_width"
    ),
    "Kass and Raftery 1995: log evidence is strong from 3, very strong from 5 on": (
        "named_least suspected_least model_log_odds"
    ),
    "Stated levels: what a user is told of chance": ("alarm_level doubt_level control_level"),
    "Baarda 1968: 4.5 standard deviations are seen at 0.1 % with a power of 90 %": (
        "detection_sigma"
    ),
    "Chandler and Bate 2007, Burnham and Anderson 2002: variance of scores by clusters": (
        "run_of_images places clusters_of_prior cluster_draws"
    ),
    "Makers of receivers (1 cm + 1 ppm, 1.5 cm + 1 ppm); Miller, O'Keefe and Gao 2012": (
        "carrier_phase_plan carrier_phase_slow time_constant_prior time_constant_range"
    ),
    "Weak knowledge of receivers": ("white_prior slow_prior noise_factor_range white_of_scatter"),
    "Tuned on simulated blocks of `benchmarks/diagnosis`": (
        "effect_sizes effect_size_weights log_prior_generic log_prior_per_image log_prior_ground "
        "leftover_share leftover_share_adjusted implausible_size gnss_share gnss_share_main "
        "overlap_share"
    ),
    "Seen on real flights (Saraburi, special_plot, brighton, garfield, sequoia)": (
        "lens_sizes named_share_of_shape shape_advantage iterations iterations_of_shapes creeping "
        "cluster_ratio wrong_control cost_ratio"
    ),
    "What an estimate can bear: few numbers do not tell their own size": (
        "fewest fewest_images least_redundancy stated_mark_weight fewest_ties enough_checks"
    ),
    "Time and memory": (
        "most_refits most_groups large_block noise_draws null_draws folds most_rivals "
        "most_asked_points most_free"
    ),
    "Wide enough to count as free, small enough to compute with": (
        "prior_of_adjusted free_size blind_information untimed_step settled"
    ),
    "Judgement": (
        "least_fit_size implausible_sigma look_alike_more_parameters same_fit_share "
        "clear_ratio_checks lines variance_ratio vibration_ratio clear_evidence"
    ),
}


def table() -> str:
    """All numbers as a table in Markdown: name, usual value, source."""
    of = {name: source for source, names in SOURCES.items() for name in names.split()}
    rows = [f"| `{name}` | {value} | {of[name]} |" for name, value in vars(Settings()).items()]
    return "\n".join(["| Number | Value | Where it comes from |", "|---|---|---|", *rows])


class _InUse:
    """The settings in use, here: of this call, or this thread."""

    def __getattr__(self, name: str):
        return getattr(_IN_USE.get(), name)


_IN_USE: ContextVar[Settings] = ContextVar("settings of a diagnosis", default=Settings())  # noqa: B039, frozen
SETTINGS = _InUse()


def side_by_side(threads: int, *works: Callable[[], Any]) -> list[Any]:
    """What each of some works gives, two at a time where there are two threads for it.

    They go by the settings in use here, and share nothing that they change.
    """
    if threads < 2 or len(works) < 2:
        return [work() for work in works]
    with ThreadPoolExecutor(2) as pool:
        jobs = [pool.submit(copy_context().run, work) for work in works]
        return [job.result() for job in jobs]


@contextmanager
def using(settings: Settings | None) -> Iterator[Settings]:
    """These settings until the `with` ends; None: those in use."""
    token = _IN_USE.set(settings or _IN_USE.get())
    try:
        yield _IN_USE.get()
    finally:
        _IN_USE.reset(token)


@contextmanager
def changed(**values) -> Iterator[_InUse]:
    """Other settings until the `with` ends. Raises AttributeError for one that is not there."""
    for name in values:
        getattr(SETTINGS, name)
    with using(replace(_IN_USE.get(), **values)):
        yield SETTINGS
