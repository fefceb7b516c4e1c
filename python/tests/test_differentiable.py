"""Functions of JAX and PyTorch against central differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import palpate
from palpate import differentiable, gradients

from test_gradients import settled, tip

YOUNG = np.array([1e4, 3e4])


def hanging(values: npt.NDArray[np.float64]) -> palpate.Simulator:
    young, stiffer = values
    return settled(young=float(young), stiffer=float(stiffer))


@pytest.fixture(scope="module")
def sag() -> differentiable.Function:
    body = hanging(YOUNG)
    node = tip(body).nodes
    quantities = [gradients.Displacement(node, (0, 0, 1)), gradients.Displacement(node, (1, 0, 0))]
    return differentiable.Function(hanging, quantities, [gradients.Young(region=0), gradients.Young(region=1)])


@pytest.fixture(scope="module")
def expected(sag: differentiable.Function) -> npt.NDArray[np.float64]:
    """Central differences of the sum of the squares of both quantities."""

    def squares(values: npt.NDArray[np.float64]) -> float:
        return float((sag(values) ** 2).sum())

    steps = np.diag(2e-3 * YOUNG)
    return np.array([(squares(YOUNG + h) - squares(YOUNG - h)) / (2 * h.sum()) for h in steps])


def check(found: Any, expected: npt.NDArray[np.float64]) -> None:
    assert np.allclose(found, expected, rtol=1e-4, atol=0), (found, expected)
    assert not np.allclose(1.001 * np.asarray(found), expected, rtol=1e-4, atol=0)


def test_jacobian_matches_differences(sag: differentiable.Function, expected: npt.NDArray[np.float64]) -> None:
    value, jacobian = sag.value_and_jacobian(YOUNG)
    assert value.shape == (2,) and jacobian.shape == (2, 2)
    check(2 * value @ jacobian, expected)
    with pytest.raises(palpate.InputError, match="shape"):
        sag([1e4])
    with pytest.raises(palpate.InputError, match="at least one"):
        differentiable.Function(hanging, [], [])


def test_jacobian_of_motion_matches_differences() -> None:
    def swinging(values: npt.NDArray[np.float64]) -> palpate.Simulator:
        scene = settled(young=float(values[0])).scene.updated({"solver.dt": 0.01})
        return palpate.Simulator(scene, precision="double")

    quantity = tip(swinging(YOUNG))
    moved = differentiable.Function(swinging, [quantity], [gradients.Young(region=0)], steps=5)
    value, jacobian = moved.value_and_jacobian([1e4])
    ends = [moved([1e4 + by])[0] for by in (20.0, -20.0)]
    assert value[0] == pytest.approx(moved([1e4])[0], rel=1e-12)
    assert jacobian[0, 0] == pytest.approx((ends[0] - ends[1]) / 40, rel=1e-3)


def test_jax_gradient_matches_differences(sag: differentiable.Function, expected: npt.NDArray[np.float64]) -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    function = sag.jax()

    def squares(values: Any) -> Any:
        return (function(values) ** 2).sum()

    check(jax.jit(jax.grad(squares))(jax.numpy.array(YOUNG)), expected)


def test_torch_gradient_matches_differences(sag: differentiable.Function, expected: npt.NDArray[np.float64]) -> None:
    torch = pytest.importorskip("torch")
    values = torch.tensor(YOUNG, requires_grad=True)
    (sag.torch()(values) ** 2).sum().backward()
    check(values.grad.numpy(), expected)
    # Slopes of the bridge itself, by its own differences.
    assert torch.autograd.gradcheck(sag.torch(), (values,), eps=20.0, rtol=1e-3, atol=1e-12)
