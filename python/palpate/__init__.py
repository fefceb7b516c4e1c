"""Simulate deformable tetrahedral meshes with contact, and render their interior.

The simulation runs on the GPU or on the CPU; a volume raycaster traverses the deformed tetrahedra::

    import palpate
    picture = palpate.render("liver.vtu", field="Temp", size=(320, 240))   # (240, 320, 4), uint8

A body argument accepts a :class:`Mesh`, a :class:`Body`, a :class:`Scene`, or the path of a mesh, a
volume, a surface or a scene file (``.toml``). Positions are in the mesh's unit, physical quantities
in SI units.
"""

from typing import TYPE_CHECKING, Any

from ._camera import Camera
from ._errors import DeviceError, Error, FileError, InputError, MissingFileError, SolverError
from ._identify import Identified, PressCurve, StiffnessMap, identify
from ._mesh import Field, Mesh
from ._palpate import __version__, adapters
from ._press import Press, PressMap, press, press_map
from ._scene import Body, Material, Scene
from ._stage import Grab, Pick, Reaction, Renderer, Simulator, render
from ._transfer import TransferFunction
from ._volume import Volume
from ._work import Tuned, study, tune, warp

if TYPE_CHECKING:
    from ._view import View

__all__ = [
    "Body",
    "Camera",
    "DeviceError",
    "Error",
    "Field",
    "FileError",
    "Grab",
    "Identified",
    "InputError",
    "Material",
    "Mesh",
    "MissingFileError",
    "Pick",
    "Press",
    "PressCurve",
    "PressMap",
    "Reaction",
    "Renderer",
    "Scene",
    "Simulator",
    "SolverError",
    "StiffnessMap",
    "TransferFunction",
    "Tuned",
    "View",
    "Volume",
    "__version__",
    "adapters",
    "identify",
    "press",
    "press_map",
    "render",
    "study",
    "tune",
    "warp",
]


def __getattr__(name: str) -> Any:
    # anywidget is required for notebooks only.
    if name == "View":
        try:
            from ._view import View
        except ImportError as why:
            raise ImportError(f"palpate.View requires anywidget; install it with pip install anywidget ({why})") from None
        return View
    raise AttributeError(f"module 'palpate' has no attribute {name!r}")
