"""Draw docs/img/paraview.png: the series that `microslip convert` writes, read and rendered by VTK, as ParaView would.

    pip install vtk
    microslip run jobs/fan_small.toml && microslip convert results/fan_small/results.h5 --to vtkhdf
    python jobs/docs/paraview.py results/fan_small docs/img/paraview.png

Left: the structure at four instants of a period, at the peak of the last level.  Right: the friction loss in the joint at each
level.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

SIZE, INSTANTS, SCALE = (1400, 700), (0, 8, 16, 24), 0.6


def step_of(path: Path, step: int):
    """Return the reader of a series at a step."""
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    reader.SetStep(step)
    reader.Update()
    return reader


def steps(path: Path) -> int:
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    return reader.GetNumberOfSteps()


def colours(low: float, high: float):
    """Return a scale from yellow to black."""
    table = vtk.vtkColorTransferFunction()
    for share, rgb in ((0.0, (0.98, 0.98, 0.82)), (0.35, (0.98, 0.6, 0.2)), (0.7, (0.7, 0.15, 0.25)), (1.0, (0.1, 0.02, 0.15))):
        table.AddRGBPoint(low + share * (high - low), *rgb)
    return table


def structure(path: Path, step: int):
    """Return the displaced structure at a step, coloured by the displacement."""
    grid = step_of(path, step).GetOutput()
    u = vtk_to_numpy(grid.GetPointData().GetArray("displacement"))
    points, size = vtk.vtkPoints(), numpy_to_vtk(np.linalg.norm(u, axis=1), deep=True)
    points.SetData(numpy_to_vtk(vtk_to_numpy(grid.GetPoints().GetData()) + SCALE * u, deep=True))
    grid.SetPoints(points)
    size.SetName("size")
    grid.GetPointData().SetScalars(size)
    mapper, actor = vtk.vtkDataSetMapper(), vtk.vtkActor()
    mapper.SetInputData(grid)
    mapper.SetLookupTable(colours(0.0, 0.03))
    actor.SetMapper(mapper)
    return actor


def joint(path: Path, step: int, most: float):
    """Return the joint at a level, coloured by its friction loss per area and cycle."""
    mapper, actor = vtk.vtkPolyDataMapper(), vtk.vtkActor()
    mapper.SetInputData(step_of(path, step).GetOutput())
    mapper.SetScalarModeToUseCellFieldData()
    mapper.SelectColorArray("friction_loss_J_m2")
    mapper.SetLookupTable(colours(0.0, most))
    actor.SetMapper(mapper)
    actor.GetProperty().SetLighting(False)
    actor.GetProperty().EdgeVisibilityOn()
    actor.GetProperty().SetEdgeColor(0.6, 0.6, 0.6)
    return actor


def put(window, box: tuple[float, float, float, float], actor, view: tuple[float, float, float], up: int, zoom: float) -> None:
    """Place an actor in a part of the window, seen from a point with an axis upward."""
    renderer = vtk.vtkRenderer()
    renderer.SetViewport(*box)
    renderer.SetBackground(1.0, 1.0, 1.0)
    renderer.AddActor(actor)
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*view)
    camera.SetViewUp(*np.eye(3)[up])
    camera.ParallelProjectionOn()
    renderer.ResetCamera()
    camera.Zoom(zoom)
    window.AddRenderer(renderer)


def write(window, x: float, y: float, text: str) -> None:
    """Write a text at a place of the window, in fractions of its size."""
    words, renderer = vtk.vtkTextActor(), vtk.vtkRenderer()
    words.SetInput(text)
    words.GetTextProperty().SetColor(0.1, 0.1, 0.1)
    words.GetTextProperty().SetFontSize(18)
    words.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
    words.GetPositionCoordinate().SetValue(0.02, 0.2)
    renderer.SetViewport(x, y, min(x + 0.4, 1.0), y + 0.06)
    renderer.SetBackground(1.0, 1.0, 1.0)
    renderer.AddViewProp(words)
    window.AddRenderer(renderer)


def main(folder: Path, picture: str) -> None:
    """Draw the picture of the results in a folder."""
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(8)
    window.SetSize(*SIZE)
    paper = vtk.vtkRenderer()
    paper.SetBackground(1.0, 1.0, 1.0)
    window.AddRenderer(paper)
    n = steps(folder / "joint.vtkhdf")
    motion = folder / f"motion_{n - 1:04d}.vtkhdf"
    for i, step in enumerate(INSTANTS):
        put(window, (0.14 * i, 0.0, 0.14 * (i + 1), 0.94), structure(motion, step), (0.3, -1.0, 0.35), 2, 0.98)
    last = step_of(folder / "joint.vtkhdf", n - 1).GetOutput().GetCellData().GetArray("friction_loss_J_m2").GetRange()[1]
    for level in range(n):
        top = 0.94 * (1.0 - level / n)
        box = (0.72, top - 0.94 / n, 1.0, top)
        write(window, 0.58, top - 0.5 * 0.94 / n - 0.03, f"level {level + 1} of {n}")
        put(window, box, joint(folder / "joint.vtkhdf", level, last), (0.0, 0.0, -1.0), 0, 1.75)
    write(window, 0.02, 0.94, "motion in a period, by size (0 to 30 mm)")
    write(window, 0.58, 0.94, f"friction loss a cycle, 0 to {last:.3g} J/m2")
    window.Render()
    grab, writer = vtk.vtkWindowToImageFilter(), vtk.vtkPNGWriter()
    grab.SetInput(window)
    writer.SetFileName(picture)
    writer.SetInputConnection(grab.GetOutputPort())
    writer.Write()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
