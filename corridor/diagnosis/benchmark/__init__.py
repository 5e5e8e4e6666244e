"""The benchmark of hidden effects: how often is the diagnosis right, and by how much?

`of_folder` and `of_generator` give trials, `run(trials, folder)` makes a row of each block,
`summary(rows)` the figures, `as_text` and `save` show and keep them.
"""

from corridor.diagnosis.benchmark.run import KEPT, run
from corridor.diagnosis.benchmark.save import save
from corridor.diagnosis.benchmark.summary import summary
from corridor.diagnosis.benchmark.table import as_text
from corridor.diagnosis.benchmark.trials import Trial, of_folder, of_generator

__all__ = ["KEPT", "Trial", "as_text", "of_folder", "of_generator", "run", "save", "summary"]
