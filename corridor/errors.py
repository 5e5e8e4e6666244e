"""The two ways in which a call can end badly."""


class InputError(ValueError):
    """The input is wrong: one sentence that names the file, the row and what to do."""


class AdjustmentFailed(RuntimeError):
    """The input is readable but the work cannot be done: one sentence says why."""
