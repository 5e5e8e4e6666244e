"""Images that the chain does not reach: oriented by themselves, then brought over."""

from collections.abc import Callable

import numpy as np

from corridor.adjustment.initial.chain import chain
from corridor.adjustment.initial.frame import frame_between, width
from corridor.adjustment.initial.intersection import place_new
from corridor.adjustment.initial.network import AGREEING, GATES_PX, Network
from corridor.adjustment.initial.pair import start_from_pair
from corridor.adjustment.initial.refinement import refine
from corridor.adjustment.initial.resection import FEWEST_MARKS
from corridor.adjustment.initial.settling import settle, sweep
from corridor.errors import InputError

# A frame of its own goes over to the antenna positions when it has so many images and they
# spread to a side by this share of their length, or when it has grown too long.
_FEWEST, _WIDTH, _LONG = 6, 0.1, 40


def bring_over(network: Network, say: Callable[[str], None]) -> None:
    """Orient images that the chain does not reach, in a frame of their own, and bring them over.

    Raises InputError where they hold together with nothing, or their frame cannot be found.
    """
    lost = ~network.posed
    shared = np.zeros(len(network.points), dtype=bool)
    shared[network.point[lost[network.image]]] = True
    # Oriented neighbours join, as what is known of them holds the island.
    members = lost.copy()
    members[network.image[shared[network.point]]] = True
    island = network.island(members)
    positions = np.isfinite(network.antenna).all(1)
    if not start_from_pair(island):
        raise _cannot(network, lost, "they share too few tie points with each other")

    def enough() -> bool:
        there = island.posed & positions
        count = there.sum()
        return count >= _LONG or (count >= _FEWEST and width(network.antenna[there]) > _WIDTH)

    chain(island, say, enough)
    settle(island)

    gained = island.posed & lost
    if not gained.any():
        raise _cannot(network, lost, "they share too few tie points with the others")
    frame = frame_between(island, network)
    if frame is None:
        raise _cannot(
            network,
            gained,
            "they see too few ground points with coordinates and have no GNSS position",
        )
    network.centre[gained] = frame.apply(island.centre[gained])
    network.rotation[gained] = frame.apply_to_rotations(island.rotation[gained])
    network.posed |= gained
    network.gate = max(network.gate, island.gate)
    fresh = island.known & ~network.known
    network.place[fresh] = frame.apply(island.place[fresh])
    network.known |= fresh
    network.look_through(island.interior)
    _carry(network, np.flatnonzero(gained & positions))
    settle(network)


def _carry(network: Network, images: np.ndarray) -> None:
    """Put the centres of images where GNSS has them, and fit all else to that.

    A frame of its own is bent where the camera is not known well; GNSS straightens it. Images
    that then do not see their points any more keep their own centre: their fix is wrong.
    """
    if not len(images):
        return
    rotation, centre, gate = network.rotation.copy(), network.centre.copy(), network.gate
    network.held[images] = network.trusted[images] = True
    for wide in (GATES_PX[-1], GATES_PX[-1], gate):
        network.gate = wide
        sweep(network, images)
    sees = [network.agreement(image, GATES_PX[-1]) >= AGREEING for image in images]
    wrong = images[~np.array(sees)]
    if len(wrong):
        network.held[wrong] = network.trusted[wrong] = False
        network.rotation[wrong], network.centre[wrong] = rotation[wrong], centre[wrong]
        refine(network, wrong)
        place_new(network, again=True)


def _cannot(network: Network, lost: np.ndarray, why: str) -> InputError:
    names = network.images[lost]
    some = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    plural = len(names) > 1
    return InputError(
        f"images.csv: image{'s' if plural else ''} {some} cannot be oriented: {why}; give "
        f"{'their poses' if plural else 'its pose'}, measure at least {FEWEST_MARKS} ground "
        f"points in {'one of them' if plural else 'it'}, or delete {'them' if plural else 'it'}"
    )
