"""Made by docs/stub.py; do not edit."""

from collections.abc import Callable
from collections.abc import Iterable
from collections.abc import Mapping
from collections.abc import Sequence
from corridor.core import effects as effects
from corridor.core import gnss as gnss
from corridor.core.adjustment import Adjustment as Adjustment
from corridor.core.adjustment import Model as Model
from corridor.core.adjustment import MotionScale as MotionScale
from corridor.core.adjustment import Run as Run
from corridor.core.adjustment.model import ParameterSettings as ParameterSettings
from corridor.core.block import Block as Block
from corridor.core.block import Summary as Summary
from corridor.core.camera import Camera as Camera
from corridor.core.effects import Effect as Effect
from corridor.core.errors import AdjustmentFailed as AdjustmentFailed
from corridor.core.errors import CorridorError as CorridorError
from corridor.core.errors import FetchFailed as FetchFailed
from corridor.core.errors import InputError as InputError
from corridor.core.errors import ReadoutFailed as ReadoutFailed
from corridor.core.errors import WorkFailed as WorkFailed
from corridor.core.output import Progress as Progress
from corridor.core.preparation import Prepared as Prepared
from corridor.core.simulation import Noise as Noise
from corridor.core.simulation import Plan as Plan
from corridor.core.simulation import Simulated as Simulated
from corridor.core.simulation import Start as Start
from corridor.diagnosis import Diagnosis as Diagnosis
from corridor.diagnosis import Settings as Settings
from corridor.diagnosis.forward_selection import Question as Question
from corridor.interface import figures as figures
from corridor.tools import certificate as certificate
from corridor.tools import data as data
from corridor.tools import readout as readout
from corridor.tools import thermal as thermal
from corridor.tools.batch import BatchResult as BatchResult
from corridor.tools.certificate import Verified as Verified
from corridor.tools.change import Change as Change
from corridor.tools.change import Comparison as Comparison
from corridor.tools.change.changing import Dated as Dated
from corridor.tools.check import Checked as Checked
from corridor.tools.faults import Fault as Fault
from corridor.tools.formats import Additions as Additions
from corridor.tools.formats import Exported as Exported
from corridor.tools.formats import Imported as Imported
from corridor.tools.planning import Carried as Carried
from corridor.tools.planning import GnssNoise as GnssNoise
from corridor.tools.planning import Planned as Planned
from corridor.tools.planning import Surveyed as Surveyed
from corridor.tools.planning.planned import Control as Control
from corridor.tools.planning.planner import Believed as Believed
from pathlib import Path
from typing import Any
import numpy as np
import os

__version__: str

def read(folder: str | os.PathLike | Block) -> Block: ...

def summary(block: Block | str | os.PathLike) -> Summary: ...

def prepare(block: Block | str | os.PathLike, velocities: bool = ...) -> Prepared: ...

def adjust(block: Block | str | os.PathLike, camera: str | Iterable[str] | Mapping[str, str] | None = ..., effects: str | Effect | Iterable[str | Effect] = ..., control: str | Iterable[str] | None = ..., check: str | Iterable[str] | None = ..., priors: Mapping[str, tuple[float, float]] | None = ..., lever_arm: str | None = ..., loss: str = ..., parameters: ParameterSettings = ..., motion: MotionScale | None = ..., *, threads: int = ..., progress: Callable[[Progress], None] | None = ..., max_iterations: int | None = ..., strict: bool = ..., reject_gnss: bool = ..., weights: str = ..., model: Model | None = ..., run: Run | None = ...) -> Adjustment: ...

def diagnose(block: Block | str | os.PathLike, camera: str | Iterable[str] | Mapping[str, str] | None = ..., effects: str | Effect | Iterable[str | Effect] = ..., control: str | Iterable[str] | None = ..., check: str | Iterable[str] | None = ..., priors: Mapping[str, tuple[float, float]] | None = ..., lever_arm: str | None = ..., loss: str = ..., parameters: ParameterSettings = ..., motion: MotionScale | None = ..., *, only: str | Iterable[str] | None = ..., without: str | Iterable[str] = ..., level: float = ..., seed: int = ..., settings: Settings | None = ..., threads: int = ..., progress: Callable[[Progress], None] | None = ..., max_iterations: int | None = ..., strict: bool = ..., model: Model | None = ..., asked: Question | None = ..., run: Run | None = ...) -> Diagnosis: ...

def check_project(project: str | os.PathLike, output: str | os.PathLike, *, form: str = ..., required: float | None = ..., added: dict[str, Any] | None = ..., diagnose: bool = ..., certificate: str | None = ..., threads: int = ..., progress: Callable[[Progress], None] | None = ...) -> Checked: ...

def batch(verb: str, blocks: str | os.PathLike | Iterable[str | os.PathLike], output: str | os.PathLike, jobs: int | None = ..., cluster: str | None = ..., memory_gb: float | None = ..., progress: Callable[[Progress], None] | None = ..., **options: Any) -> BatchResult: ...

def simulate(plan: Plan | str | os.PathLike, effects: Mapping[str, Mapping] | None = ..., seed: int = ..., *, noise: Noise | Mapping | str | None = ..., start: Start | Mapping | None = ..., progress: Callable[[Progress], None] | None = ...) -> Simulated: ...

def plan(plans: Plan | str | os.PathLike | Sequence[Plan | str], control: int | Sequence[Control] = ..., place: str = ..., goals: float | Sequence[float] = ..., combined: bool | None = ..., detection: bool = ..., progress: Callable[[Progress], None] | None = ..., *, camera: str | Mapping[str, str] | None = ..., lever_arm: str = ..., effects: Iterable[str | Effect] = ..., priors: Mapping[str, float] | None = ..., model: Model | None = ..., carried: Carried | None = ..., noise: GnssNoise | None = ..., surveyed: Surveyed | None = ..., seed: int = ..., jobs: int = ..., cluster: str | None = ..., believed: Believed | None = ...) -> Planned: ...

def correct(block: Block | str | os.PathLike, effects: str | Iterable[str] | Mapping[str, Mapping | None], notes: Sequence[str] = ..., *, source: str | os.PathLike | None = ..., velocity: str | None = ..., turning: str = ...) -> Block: ...

def import_project(path: str | Path, form: str, output: str | Path, *, photos: Path | None = ..., track: Path | None = ..., ground: Path | None = ..., crs: str | None = ..., ground_crs: str | None = ..., to_crs: str | None = ..., size: tuple[int, int] | None = ..., track_system: str | None = ..., images_system: str | None = ..., long_side: int | None = ..., share: int = ..., attitudes: bool = ..., table_form: str = ..., force: bool = ..., unadjusted: bool = ..., progress: Callable[[Progress], None] | None = ..., added: Additions | None = ...) -> Imported: ...

def export(block: Block | str | Path, form: str, folder: str | Path, *, effects: Mapping[str, Mapping] | None = ..., corrected: bool = ..., lossy: bool = ..., to_crs: str | None = ..., progress: Callable[[Progress], None] | None = ...) -> Exported: ...

def report_bug(block: Block | str | os.PathLike, command: str, output: str | os.PathLike, progress: Callable[[Progress], None] | None = ...) -> Fault: ...

def verify(certificate: str | os.PathLike, block: str | os.PathLike) -> Verified: ...

def catalogue() -> list[Effect]: ...

class _Change:
    def __call__(self, before: Dated, after: Dated, model: Model | None = ..., *, common: str | Iterable[str] = ..., gnss_bias: float | Iterable[float] | None = ..., datum: str | None = ..., motion: str = ..., level: float = ..., surface: bool = ..., camera: bool = ..., together: bool = ..., stable: str | Iterable[str] | None = ..., same_camera: bool = ..., reject_gnss: bool = ..., largest: float = ..., spacing: float | None = ..., radius: float | None = ..., normal: str = ..., degree: int | None = ..., profile: np.ndarray | None = ..., polygons: Mapping[str, np.ndarray] | None = ..., rays: int = ..., same_ties: bool = ..., threads: int = ..., progress: Callable[[Progress], None] | None = ..., asked: Comparison | None = ...) -> Change: ...
    def __getattr__(self, name: str) -> Any: ...

change: _Change
