"""Effects that move each axis by the same terms: their shift without their derivative."""

import numpy as np
import pytest
from strips import corridor_block

from corridor.core.effects import AlongAxes, every_effect
from corridor.core.effects.context import Context, Images
from corridor.core.effects.stack import Stack

ALIKE = [e.slug for e in every_effect() if isinstance(e, AlongAxes) and e.place == "image"]


@pytest.mark.parametrize("slug", ALIKE)
def test_the_shift_alone_is_that_beside_the_derivative(slug):
    block, rng = corridor_block(images=6), np.random.default_rng(0)
    effect = next(e for e in every_effect() if e.slug == slug)
    stack, images = Stack(block, [effect]), Images.of(block)
    image = rng.integers(0, 6, 40)
    seen = Context(
        images, image, pixel=rng.uniform(0, images.size[image] - 1), ray=np.zeros((40, 2))
    )
    values = {slug: rng.standard_normal(stack.members[slug].shape)}
    whole, derivative = stack.evaluate("image", seen, values)
    assert derivative.shape[1] == 2 and np.abs(whole).max() > 0.0
    assert stack.shift("image", seen, values) == pytest.approx(whole, rel=1e-12, abs=1e-12)
    form, mine = stack.members[slug].effect, values[slug]
    of_group = mine[seen.group(form.group)] if form.group != "block" else mine
    moved, slope = form.shift(seen, of_group)
    assert whole == pytest.approx(moved, rel=1e-12, abs=1e-12)
    assert np.array_equal(derivative, slope)


def test_there_are_some():
    assert {"image_deformation", "image_steps", "sensor_unflatness"} <= set(ALIKE)
