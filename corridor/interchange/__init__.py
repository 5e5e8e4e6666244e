"""Other programs' projects, in and out; every import is proved by reprojection.

project = corridor.interchange.read_project("sparse/0")
print(corridor.interchange.prove(project))
project.block.write("block")
"""

from corridor.interchange.control import add_ground
from corridor.interchange.exporting import (
    Exported,
    export_names,
    export_project,
    read_adjusted,
)
from corridor.interchange.importing import Additions, Imported, complete, import_project
from corridor.interchange.project import Project
from corridor.interchange.proof import Proof, Residuals, demand, prove
from corridor.interchange.reading import format_names, read_project
from corridor.photographs import Metadata as Photograph
from corridor.photographs import read_metadata as read_photograph

__all__ = [
    "Additions",
    "Exported",
    "Imported",
    "Photograph",
    "Project",
    "Proof",
    "Residuals",
    "add_ground",
    "complete",
    "demand",
    "export_names",
    "export_project",
    "format_names",
    "import_project",
    "prove",
    "read_adjusted",
    "read_photograph",
    "read_project",
]
