"""What has been taken out of a block's measurements: the table `corrected` of its block.toml."""

from collections.abc import Mapping, Sequence

from corridor.core.block.block import Block
from corridor.core.errors import InputError

_TABLE = "corrected"


def record_correction(block: Block, done: Mapping[str, Mapping], notes: Sequence[str] = ()) -> None:
    """Write into the block what is taken out of it, so that no one takes it out twice.

    done: what is taken out by the slug of its effect. notes: sentences for the reader.
    Raises InputError where it has been taken out before.
    """
    before = block.extra.get(_TABLE, {})
    for slug in done:
        if slug in before:
            raise InputError(
                f"block.toml says that {slug} has been taken out of this block already: correct "
                f"the block it was made from, or remove its entry in [{_TABLE}]"
            )
    told = [*before.get("notes", []), *notes]
    block.extra[_TABLE] = {**before, **done} | ({"notes": told} if told else {})


def forget_correction(block: Block, slug: str) -> None:
    """Strike one effect, and the notes, from what the block says has been taken out of it."""
    left = {k: v for k, v in block.extra.pop(_TABLE, {}).items() if k not in (slug, "notes")}
    if left:
        block.extra[_TABLE] = left


def taken_out(block: Block) -> dict[str, Mapping]:
    """What has been taken out of the block, by the slug of its effect."""
    return {k: v for k, v in block.extra.get(_TABLE, {}).items() if k != "notes"}
