"""Other programs' projects, in and out; every import is proved by reprojection.

project = corridor.interchange.read_project("sparse/0")
print(corridor.interchange.prove(project))
project.block.write("block")
"""

from corridor.core.photographs import Metadata as Photograph
from corridor.core.photographs import read_metadata as read_photograph
from corridor.tools.formats.control import add_ground, ground_seen
from corridor.tools.formats.exporting import Exported, export_names, export_project, read_adjusted
from corridor.tools.formats.ground import read_gcp_list
from corridor.tools.formats.importing import Additions, Imported, complete, import_project
from corridor.tools.formats.programs import candidates
from corridor.tools.formats.project import Project
from corridor.tools.formats.proof import Proof, Residuals, demand, prove
from corridor.tools.formats.reading import format_names, read_project
from corridor.tools.formats.rows import camera_positions
