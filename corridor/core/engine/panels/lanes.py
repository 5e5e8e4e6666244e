"""Panels: eight numbers that compiled code handles at once, on vectors as wide as the machine has.

Numba would find such vectors in straight-line code only after a long search, and not all. In
compiled functions a panel is added, multiplied and divided like a number, also with a number.
"""

import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from corridor.core.engine.scene import PANEL

_DOUBLE, _INDEX = ir.DoubleType(), ir.IntType(32)
_EIGHT = ir.VectorType(_DOUBLE, PANEL)
_ZEROS = ir.Constant(_EIGHT, [0.0] * PANEL)
# As where whole functions are compiled: a product and a sum may be rounded once.
_FUSED = ("contract",)


class Panel(types.Type):
    """Type of a panel in compiled code."""

    def __init__(self):
        super().__init__(name=f"Panel({PANEL})")


_PANEL = Panel()


@register_model(Panel)
class _PanelModel(models.PrimitiveModel):
    def __init__(self, manager, of):
        super().__init__(manager, of, _EIGHT)


# --- arithmetic ---------------------------------------------------------------------------------


def _same(builder, number):
    """The panel of one number."""
    one = builder.insert_element(ir.Constant(_EIGHT, ir.Undefined), number, _INDEX(0))
    return builder.shuffle_vector(one, one, _lanes(*[0] * PANEL))


def _lanes(*numbers):
    return ir.Constant(ir.VectorType(_INDEX, len(numbers)), list(numbers))


def _offer(symbol, made: str) -> None:
    """Let compiled code use an operator with panels; made: the instruction of it."""

    @infer_global(symbol)
    class _Typed(AbstractTemplate):
        def generic(self, args, kws):
            panels = [isinstance(a, Panel) for a in args]
            numbers = [isinstance(a, types.Float) for a in args]
            if any(panels) and all(a or b for a, b in zip(panels, numbers, strict=True)):
                return signature(_PANEL, *(_PANEL if p else types.float64 for p in panels))
            return None

    def lower(context, builder, signature, arguments):
        both = [
            value if isinstance(kind, Panel) else _same(builder, value)
            for kind, value in zip(signature.args, arguments, strict=True)
        ]
        return getattr(builder, made)(*both, flags=_FUSED)

    for kinds in ((Panel, Panel), (Panel, types.Float), (types.Float, Panel)):
        lower_builtin(symbol, *kinds)(lower)


for _symbols, _instruction in (
    ((operator.add, operator.iadd), "fadd"),
    ((operator.sub, operator.isub), "fsub"),
    ((operator.mul, operator.imul), "fmul"),
    ((operator.truediv, operator.itruediv), "fdiv"),
):
    for _symbol in _symbols:
        _offer(_symbol, _instruction)


@infer_global(operator.neg)
class _Negative(AbstractTemplate):
    def generic(self, args, kws):
        return signature(_PANEL, _PANEL) if isinstance(args[0], Panel) else None


@lower_builtin(operator.neg, Panel)
def _negative(context, builder, signature, arguments):
    return builder.fneg(*arguments)


@intrinsic
def same(typing, number):
    """The panel of one number."""

    def code(context, builder, signature, arguments):
        return _same(builder, *arguments)

    return _PANEL(types.float64), code


@intrinsic
def zeros(typing):
    """A panel of zeros."""

    def code(context, builder, signature, arguments):
        return _ZEROS

    return _PANEL(), code


@intrinsic
def plus(typing, p, f, q):
    """p + f q; f: a number."""

    def code(context, builder, signature, arguments):
        p, f, q = arguments
        product = builder.fmul(_same(builder, f), q, flags=_FUSED)
        return builder.fadd(p, product, flags=_FUSED)

    return _PANEL(_PANEL, types.float64, _PANEL), code


@intrinsic
def root(typing, p):
    """Square root, number by number."""

    def code(context, builder, signature, arguments):
        kind, name = ir.FunctionType(_EIGHT, [_EIGHT]), f"llvm.sqrt.v{PANEL}f64"
        function = cgutils.get_or_insert_function(builder.module, kind, name)
        return builder.call(function, arguments)

    return _PANEL(_PANEL), code


@intrinsic
def where_positive(typing, p, q, r):
    """q where p > 0, and r elsewhere."""

    def code(context, builder, signature, arguments):
        p, q, r = arguments
        return builder.select(builder.fcmp_ordered(">", p, _ZEROS), q, r)

    return _PANEL(_PANEL, _PANEL, _PANEL), code


@intrinsic
def total(typing, p):
    """Sum of the numbers."""

    def code(context, builder, signature, arguments):
        (p,) = arguments
        for size in (4, 2, 1):
            half = _lanes(*[(k + size) % PANEL for k in range(PANEL)])
            p = builder.fadd(p, builder.shuffle_vector(p, p, half))
        return builder.extract_element(p, _INDEX(0))

    return types.float64(_PANEL), code


@intrinsic
def largest(typing, p):
    """The largest of the numbers."""

    def code(context, builder, signature, arguments):
        (p,) = arguments
        for size in (4, 2, 1):
            half = _lanes(*[(k + size) % PANEL for k in range(PANEL)])
            other = builder.shuffle_vector(p, p, half)
            p = builder.select(builder.fcmp_ordered(">", p, other), p, other)
        return builder.extract_element(p, _INDEX(0))

    return types.float64(_PANEL), code


@intrinsic
def lane(typing, p, k):
    """Number k of a panel."""

    def code(context, builder, signature, arguments):
        return builder.extract_element(*arguments)

    return types.float64(_PANEL, types.uint64), code


@intrinsic
def with_lane(typing, p, k, x):
    """The panel with x as number k."""

    def code(context, builder, signature, arguments):
        p, k, x = arguments
        return builder.insert_element(p, x, k)

    return _PANEL(_PANEL, types.uint64, types.float64), code


@intrinsic
def from_lane(typing, p, k):
    """The panel with zeros before number k."""

    def code(context, builder, signature, arguments):
        p, k = arguments
        kind = ir.VectorType(k.type, PANEL)
        number = ir.Constant(kind, list(range(PANEL)))
        one = builder.insert_element(ir.Constant(kind, ir.Undefined), k, _INDEX(0))
        least = builder.shuffle_vector(one, one, _lanes(*[0] * PANEL))
        return builder.select(builder.icmp_unsigned(">=", number, least), p, _ZEROS)

    return _PANEL(_PANEL, types.uint64), code


@intrinsic
def transposed(typing, rows):
    """Eight panels as columns: number k of panel n becomes number n of panel k."""

    def code(context, builder, signature, arguments):
        rows = [builder.extract_value(arguments[0], k) for k in range(PANEL)]
        # Blocks of 1, 2 and 4 are exchanged across the diagonal.
        for size in (1, 2, 4):
            low = [k if not k & size else PANEL + k - size for k in range(PANEL)]
            high = [k + size if not k & size else PANEL + k for k in range(PANEL)]
            new = list(rows)
            for n in range(PANEL):
                if not n & size:
                    pair = rows[n], rows[n + size]
                    new[n] = builder.shuffle_vector(*pair, _lanes(*low))
                    new[n + size] = builder.shuffle_vector(*pair, _lanes(*high))
            rows = new
        return context.make_tuple(builder, signature.return_type, rows)

    eight = types.UniTuple(_PANEL, PANEL)
    return eight(eight), code


# --- memory -------------------------------------------------------------------------------------


def _pointer(context, builder, array_type, array, at):
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [at])


def _load(builder, where, count):
    kind = ir.VectorType(_DOUBLE, count)
    return builder.load(builder.bitcast(where, kind.as_pointer()), align=8)


def _store(builder, value, where):
    builder.store(value, builder.bitcast(where, value.type.as_pointer()), align=8)


@intrinsic
def panel(typing, x, at):
    """The numbers of the contiguous array x from number `at` on."""

    def code(context, builder, signature, arguments):
        where = _pointer(context, builder, signature.args[0], *arguments)
        return _load(builder, where, PANEL)

    return _PANEL(x, types.uint64), code


@intrinsic
def put(typing, x, at, p):
    """x[at:at + PANEL] = p."""

    def code(context, builder, signature, arguments):
        *place, value = arguments
        _store(builder, value, _pointer(context, builder, signature.args[0], *place))
        return context.get_dummy_value()

    return types.void(x, types.uint64, _PANEL), code


@intrinsic
def add_some(typing, x, at, p, count):
    """x[at:at + count] += p[:count]; count: at most PANEL, known when it is compiled."""

    def code(context, builder, signature, arguments):
        array, at, value, count = arguments
        start = _pointer(context, builder, signature.args[0], array, at)
        whole = builder.icmp_unsigned(">=", count, count.type(PANEL))
        with builder.if_then(whole):
            _store(builder, builder.fadd(_load(builder, start, PANEL), value), start)
        size = PANEL // 2
        while size:
            # By the bits of the count: which parts there are, and what larger ones have left.
            rest = builder.and_(count, count.type(size))
            before = builder.and_(count, count.type(PANEL - 2 * size))
            with builder.if_then(builder.icmp_unsigned("!=", rest, count.type(0))):
                for first in range(0, PANEL, 2 * size):
                    here = builder.icmp_unsigned("==", before, count.type(first))
                    with builder.if_then(here):
                        numbers = _lanes(*range(first, first + size))
                        part = builder.shuffle_vector(value, value, numbers)
                        where = builder.gep(start, [ir.IntType(64)(first)])
                        _store(builder, builder.fadd(_load(builder, where, size), part), where)
            size //= 2
        return context.get_dummy_value()

    return types.void(x, types.uint64, _PANEL, types.uint64), code
