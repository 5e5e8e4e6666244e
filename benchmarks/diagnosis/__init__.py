"""The benchmark of hidden effects: how often is the diagnosis right, and by how much?

`of_folder` and `of_generator` give trials, `run(trials, folder)` makes a row of each block,
`summary(rows)` the figures, `as_text` and `save` show and keep them.
"""

from benchmarks.diagnosis.run import KEPT, run
from benchmarks.diagnosis.save import save
from benchmarks.diagnosis.summary import summary
from benchmarks.diagnosis.table import as_text
from benchmarks.diagnosis.trials import Trial, of_folder, of_generator

__all__ = ["KEPT", "Trial", "as_text", "of_folder", "of_generator", "run", "save", "summary"]
