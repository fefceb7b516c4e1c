"""Simulations as differentiable functions for JAX and PyTorch: layers of other people's optimisers.

A function takes an array of parameter values and returns an array of quantities; its derivatives are
those of :meth:`palpate.Simulator.gradient` (or ``gradient_of_motion``), by the adjoint method::

    from palpate import differentiable, gradients

    def hanging(values):
        simulator = palpate.Simulator(scene.updated({"material.young": float(values[0])}), precision="double")
        simulator.advance(30)
        return simulator

    sag = differentiable.Function(hanging, [tip], [gradients.Young()])
    value, slopes = sag.value_and_jacobian([1e4])
    jax.grad(lambda v: (sag.jax()(v)[0] + 0.01) ** 2)(jnp.array([1e4]))
    sag.torch()(torch.tensor([1e4], dtype=torch.float64, requires_grad=True)).sum().backward()
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ._errors import InputError
from ._stage import Simulator
from .gradients import Parameter, Quantity

__all__ = ["Function"]

Array = npt.NDArray[np.float64]


class Function:
    """Quantities of a simulation as a differentiable function of parameter values.

    Args:
        simulate: called with the values, shape (n,), in the units of the parameters; returns a simulator
            with them, in double precision: at rest, or, with ``steps``, before its motion.
        quantities: quantities, such as :class:`palpate.gradients.Displacement`.
        parameters: what each value is, such as :class:`palpate.gradients.Young`, in their order.
        steps: number of steps of the motion at whose end the quantities are taken; default: the body is
            at rest. Each quantity is a motion of its own.
    """

    def __init__(
        self,
        simulate: Callable[[Array], Simulator],
        quantities: Sequence[Quantity],
        parameters: Sequence[Parameter],
        steps: int | None = None,
    ) -> None:
        if not quantities or not parameters:
            raise InputError("a differentiable function needs at least one quantity and one parameter")
        self._simulate = simulate
        self._quantities = list(quantities)
        self._parameters = list(parameters)
        self._steps = steps

    def __call__(self, values: npt.ArrayLike) -> Array:
        """Returns the quantities at these values, shape (m,)."""
        return self._evaluate(values, [])[0]

    def value_and_jacobian(self, values: npt.ArrayLike) -> tuple[Array, Array]:
        """Returns the quantities, shape (m,), and their derivatives by each value, shape (m, n)."""
        return self._evaluate(values, self._parameters)

    def _evaluate(self, values: npt.ArrayLike, by: list[Parameter]) -> tuple[Array, Array]:
        given = np.array(values, dtype=np.float64)
        if given.shape != (len(self._parameters),):
            raise InputError(
                f"values must have the shape ({len(self._parameters)},), one for each parameter; got {given.shape}"
            )
        rows = []
        simulator = None
        for quantity in self._quantities:
            if simulator is None or self._steps is not None:
                simulator = self._simulate(given)
            if self._steps is None:
                rows.append(simulator.gradient(quantity, by))
            else:
                rows.append(simulator.gradient_of_motion(self._steps, quantity, by))
        return np.array([row.value for row in rows]), np.array([row.derivatives for row in rows])

    def jax(self) -> Callable[[Any], Any]:
        """Returns it as a function of JAX, with reverse-mode derivatives (``jax.custom_vjp``); it may be
        compiled (``jax.jit``). JAX computes in single precision unless ``jax_enable_x64`` is set."""
        import jax

        m, n = len(self._quantities), len(self._parameters)

        def shape(like: Any, *lengths: int) -> Any:
            return jax.ShapeDtypeStruct(lengths, like.dtype)

        def value(values: Any) -> Any:
            def own(x: Any) -> Any:
                return self(x).astype(values.dtype)

            return jax.pure_callback(own, shape(values, m), values)

        def forward(values: Any) -> tuple[Any, Any]:
            def own(x: Any) -> Any:
                return tuple(each.astype(values.dtype) for each in self.value_and_jacobian(x))

            return jax.pure_callback(own, (shape(values, m), shape(values, m, n)), values)  # type: ignore[no-any-return]

        def backward(jacobian: Any, by: Any) -> tuple[Any]:
            return (by @ jacobian,)

        function = jax.custom_vjp(value)
        function.defvjp(forward, backward)
        return function  # type: ignore[no-any-return]

    def torch(self) -> Callable[[Any], Any]:
        """Returns it as a function of PyTorch tensors, with reverse-mode derivatives
        (``torch.autograd.Function``)."""
        import torch

        owner = self

        class Simulation(torch.autograd.Function):  # type: ignore[misc]
            @staticmethod
            def forward(ctx: Any, values: Any) -> Any:
                given = values.detach().cpu().double().numpy()
                if values.requires_grad:
                    found, jacobian = owner.value_and_jacobian(given)
                    ctx.save_for_backward(torch.as_tensor(jacobian, dtype=values.dtype, device=values.device))
                else:
                    found = owner(given)
                return torch.as_tensor(found, dtype=values.dtype, device=values.device)

            @staticmethod
            def backward(ctx: Any, by: Any) -> Any:
                (jacobian,) = ctx.saved_tensors
                return by @ jacobian

        return Simulation.apply  # type: ignore[no-any-return]
