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
from typing import Any


@dataclass(frozen=True)
class Settings:
    """Sizes of effects are in prior standard deviations, evidence in natural logarithms."""

    # --- reference model and image noise
    # Least and most by which a stated sigma may be wrong, as factors; the loss sees nothing else.
    stated_sigma_range: tuple[float, float] = (0.02, 20.0)
    # Degrees of freedom of Student's t, and the width of Cauchy's weights that have them.
    student_nu: float = 4.0
    cauchy_width: float = 2.0
    # Prior sigma of an adjusted effect that could stand in for the camera; of values per image.
    prior_of_adjusted: float = 10.0
    prior_of_adjusted_per_image: float = 1.0
    # Flights without GNSS worth the name take 71 to 83 (special_plot, brighton). Shapes
    # with a hundred parameters creep to their end, and need not reach it (the cost of special_plot
    # falls by 0.3 % in the last of six; that of garfield, far from its start, by 17 % and more).
    iterations: int = 200
    # Beyond as many (garfield's 134 to 200) the believed model has bent the block to its errors:
    # a turn of 164 ms fitted from there comes to 130 ms, at a higher cost.
    usual_iterations: int = 100
    # Iterations after which it is asked whether only weights creep on: five of them gain less than
    # this share of the cost.
    iterations_asked: int = 40
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

    # --- halves
    # Chance of an alarm of two halves in a sound block.
    halves_level: float = 0.01

    # --- clusters of residuals
    # Images of a run, and places of the picture (columns, rows) whose residuals hang together.
    run_of_images: int = 10
    places: tuple[int, int] = (8, 6)
    # Clusters from which on their spread says something; clusters that the prior knowledge, which
    # is that residuals are independent, is worth.
    fewest_clusters: float = 3.0
    clusters_of_prior: float = 10.0
    # Draws of independent noise that say how much of it residuals of a cluster keep.
    cluster_draws: int = 3

    # Strips from which on a finding is asked of each with the others' value.
    fewest_strips: int = 4

    # --- lens
    # Sizes of what polynomials leave of it, among which the data choose: 0.2 to 0.3 px, 0.4 to 0.6
    # of these, in the survey of Saraburi.
    lens_sizes: tuple[float, ...] = (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 2.0)

    # --- ground control
    # Chance of calling a point of a block without any blunder wrong.
    control_level: float = 0.002
    # Share of the control points of a survey that are wrong.
    wrong_control: float = 0.02

    # --- thresholds
    null_draws: int = 1000
    # Noise is never quite what its model says: no block is accused below these. What is judged
    # beside noise of any size and slowness has paid for some of that already. Tuned.
    named_least: float = 4.0
    beside_noise_least: float = 3.0
    suspected_least: float = 2.5
    # Level of a suspicion in levels of a name, and at most.
    suspected_level_factor: float = 5.0
    suspected_level_most: float = 0.05

    # --- search
    most_refits: int = 3
    most_groups: int = 6
    # Share of the largest evidence below which a group is what its linearisation left, as long as
    # that one has not been adjusted; then, what its physics are too simple for. Tuned.
    leftover_share: float = 0.02
    leftover_share_adjusted: float = 0.002
    # Evidence from which on an effect shows through any noise of the GNSS.
    clear_evidence: float = 40.0
    shortlist: int = 6
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
    # A named effect with less than this share of a generic one's evidence, in the same kind of
    # measurements, is what a wrong model leaves; one of this size beside it is two shapes that
    # nearly cancel, and no cause. Tuned.
    share_beside_generic: float = 0.5
    implausible_size: float = 100.0
    # Share of the larger one of its evidences, with a shape and without, from which on the smaller
    # one says that the two have nothing to do with each other.
    share_of_its_own: float = 0.7
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
    # Coordinates below which nothing is estimated.
    few_antenna_coordinates: int = 12
    # Noises that an effect's uncertainty is averaged over, and how much wider than the curvature
    # says they are drawn.
    noise_draws: int = 16
    noise_draws_widened: float = 1.2
    # Seconds between images where no times are known.
    untimed_step: float = 2.0
    # Share of what a group explains that the antenna positions see, from which on its evidence is
    # held against noise of the GNSS; from which on it is a matter of the GNSS.
    gnss_share: float = 0.01
    gnss_share_main: float = 0.3

    # --- verdict
    # Log odds within which two explanations are equally good: a hundred, as of the level.
    look_alike_log_odds: float = 4.6
    # What one more parameter may cost in evidence while the fit is the same, and how many more.
    evidence_per_parameter: float = 4.0
    look_alike_more_parameters: int = 3
    # Share of a fit below which something else is no explanation of the same.
    same_fit_share: float = 0.5
    # Share of a generic group's evidence from which on a named effect is a part of it.
    overlap_share: float = 0.1
    most_parts: int = 3
    # Standard deviations at which an effect is seen nearly always; share of the prior's sigma at
    # which the prior is all that is known.
    detection_sigma: float = 4.5
    unknown_sigma_share: float = 0.99

    # --- held-out data
    held_out_share: float = 0.08
    # Share of the places of each picture of which observations are held out.
    held_out_places: float = 0.15
    # Parts of the places that are left out in turn, each about that share of them.
    folds: int = 7
    # Rays that a point has at least of which one is held out.
    held_out_rays: int = 4
    # Factor on the sigma of a held-out observation: it has no say.
    held_out_sigma: float = 1e4
    # Fewest tie observations of which some can be spared.
    fewest_ties: int = 200
    # Chance at which a gain in predictions would be no gain; the test holds below 8 %.
    prediction_level: float = 0.05
    # Standard deviations by which check points have to contradict an effect: one in twenty of the
    # true ones may.
    harm_sigma: float = 1.645
    # Chance of check points as far off as they are, below which control is asked with their help.
    check_chance: float = 0.05
    # Check points that are asked, where there are more.
    most_asked_points: int = 60
    # Check points from which on they decide. Ratios of errors that are more than chance: one in two
    # hundred of ties; of check points, which are few and each shift of the datum moves, more; a
    # shape has more parameters than an effect, and no cause that anyone knows.
    enough_checks: int = 3
    clear_ratio_ties: float = 0.995
    clear_ratio_checks: float = 0.8
    clear_ratio_shape: float = 0.5
    # Difference of the check points' misfit, a chi square, by which they tell which control is
    # wrong: a hundred to one.
    check_odds: float = 9.2
    most_rivals: int = 4
    most_shapes: int = 3

    # A shape of the picture is worth a word where it moves the ground by so many of its sigmas, or
    # takes the error of data that no fit has used below this share.
    cost_sigmas: float = 2.0
    cost_ratio: float = 0.95

    # --- wrong matches
    # Scales of Student's t from which on an observation has next to no say in the fit.
    outlier_scales: float = 4.0
    # Chance of a false alarm of one kind in a block without any cause, over all places.
    outlier_level: float = 0.001
    # A line of the picture: how many are tried along its longer side; how far apart, of that side,
    # two observations of one point may lie: farther, a smooth deformation tells them apart too.
    lines: int = 512
    line_reach: float = 1 / 16
    # Share of the pairs that a rim moves, and images: several points on one car are one match.
    line_share: float = 0.5
    line_images: int = 6
    # Pairs that what is usual elsewhere counts for, beside those that jump the other way here.
    line_prior_pairs: float = 10.0
    # A cluster: cells of the picture, squares of so many of them a side, lengths of runs of images.
    cluster_cells: tuple[int, int] = (16, 12)
    cluster_squares: tuple[int, ...] = (1, 2, 4)
    cluster_runs: tuple[int, ...] = (1, 2, 4, 8)
    # Times the usual share (corners of real pictures have twice as much), wrong matches, images.
    cluster_ratio: float = 3.0
    cluster_fewest: int = 8
    cluster_images: int = 4

    # --- changes of the image noise
    # Chance of an alarm in a block without any cause, over all quantities.
    variance_level: float = 0.01
    # Ratio of the standard deviations at both ends: the noise that points with few rays leave is
    # known no better. Of a vibration: a fiftieth of the variance that rows read together share.
    variance_ratio: float = 1.25
    vibration_ratio: float = 1.01
    variance_fewest: int = 500
    variance_images: int = 8
    # Strips of rows of one image that are taken together, and observations that one needs.
    strips: int = 16
    in_strip: int = 3
    # Bound of a squared length, in its usual size.
    most_squared: float = 6.0

    # --- where an unknown lies
    place_cells: tuple[int, int] = (16, 12)
    # Share of the largest deformation that still belongs to the place.
    place_share: float = 0.6
    # Size up to which an effect may go to imitate another, and information below which the block
    # says nothing of an effect.
    imitation_size: float = 10.0
    unseen_information: float = 1e-3


# Where the numbers come from: names by source. The page of settings in the documentation has them.
SOURCES = {
    "Heavy tails of matches: Student's t, and Cauchy's weights that go with it": (
        "student_nu cauchy_width mark_cauchy_width"
    ),
    "Kass and Raftery 1995: log evidence is strong from 3, very strong from 5 on": (
        "named_least suspected_least beside_noise_least model_log_odds look_alike_log_odds"
    ),
    "Stated levels: what a user is told of chance": (
        "control_level halves_level suspected_level_factor suspected_level_most prediction_level "
        "check_chance check_odds harm_sigma outlier_level variance_level"
    ),
    "Baarda 1968: 4.5 standard deviations are seen at 0.1 % with a power of 90 %": (
        "detection_sigma"
    ),
    "Chandler and Bate 2007, Burnham and Anderson 2002: variance of scores by clusters": (
        "run_of_images places fewest_clusters clusters_of_prior cluster_draws"
    ),
    "Makers of receivers (1 cm + 1 ppm, 1.5 cm + 1 ppm); Miller, O'Keefe and Gao 2012": (
        "carrier_phase_plan carrier_phase_slow time_constant_prior time_constant_range"
    ),
    "Weak knowledge of receivers": "white_prior slow_prior noise_factor_range white_of_scatter",
    "Tuned on simulated blocks of `benchmarks/diagnosis`": (
        "effect_sizes effect_size_weights log_prior_generic log_prior_per_image log_prior_ground "
        "leftover_share leftover_share_adjusted share_beside_generic implausible_size "
        "share_of_its_own gnss_share gnss_share_main overlap_share"
    ),
    "Seen on real flights (Saraburi, special_plot, brighton, garfield, sequoia)": (
        "lens_sizes named_share_of_shape shape_advantage iterations usual_iterations "
        "iterations_of_shapes creeping cluster_ratio wrong_control cost_ratio"
    ),
    "What an estimate can bear: few numbers do not tell their own size": (
        "least_redundancy stated_mark_weight few_antenna_coordinates fewest_ties fewest_strips "
        "enough_checks variance_fewest variance_images cluster_fewest cluster_images line_images "
        "line_prior_pairs in_strip held_out_rays"
    ),
    "Time and memory": (
        "most_refits most_groups shortlist large_block noise_draws null_draws folds "
        "iterations_asked most_rivals most_shapes most_asked_points most_parts most_free"
    ),
    "Wide enough to count as free, small enough to compute with": (
        "stated_sigma_range prior_of_adjusted free_size held_out_sigma blind_information "
        "unseen_information imitation_size unknown_sigma_share untimed_step settled"
    ),
    "Judgement": (
        "prior_of_adjusted_per_image least_fit_size noise_draws_widened implausible_sigma "
        "look_alike_more_parameters same_fit_share held_out_share held_out_places clear_ratio_ties "
        "clear_ratio_checks clear_ratio_shape cost_sigmas outlier_scales lines line_reach "
        "line_share cluster_cells cluster_squares cluster_runs variance_ratio vibration_ratio "
        "strips most_squared place_cells place_share clear_evidence evidence_per_parameter"
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
