"""Derivatives of roots, against those of Optimistix's ImplicitAdjoint and of closed forms, up to the third order."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softgrip_jax.numerics.implicit import implicit, with_derivatives_of
from softgrip_jax.numerics.small_linear import solve_small

RANDOM = settings(max_examples=30, deadline=None, derandomize=True)


def scalar_residual(y, args):
    a, b = args["a"], args["b"]
    return y**3 + a * y - jnp.sum(b)


def vector_residual(y, args):
    """Diagonally dominant and curved, of any size."""
    matrix, right = args
    return matrix @ y + 0.1 * jnp.sin(y) * jnp.sum(y**2) - right


@partial(jax.jit, static_argnums=0)
def newtons_root(residual, y, args):
    """Values alone."""

    def step(_, y):
        if y.ndim:
            return y - jnp.linalg.solve(jax.jacfwd(residual)(y, args), residual(y, args))
        return y - residual(y, args) / jax.grad(residual)(y, args)

    return jax.lax.fori_loop(0, 30, step, y)


def optimistix_root(residual, y, args):
    solver = optx.Newton(rtol=1e-14, atol=1e-14)
    return optx.root_find(residual, solver, y, args, adjoint=optx.ImplicitAdjoint(), max_steps=64, throw=False).value


def vector_args(n, seed=0):
    random = np.random.default_rng(seed)
    return jnp.asarray(random.normal(size=(n, n)) / n + 2 * np.eye(n)), jnp.asarray(random.normal(size=n))


PROBLEMS = {
    "scalar": (scalar_residual, jnp.asarray(0.5), {"a": jnp.asarray(1.3), "b": jnp.array([0.4, 0.9])}),
    **{f"{n} unknowns": (vector_residual, jnp.zeros(n), vector_args(n)) for n in (2, 5)},
}


@pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS)
def test_as_optimistix_forward_and_reverse(problem):
    residual, start, args = problem
    root = newtons_root(residual, start, args)

    def ours(args):
        return implicit(residual, root, args)

    def theirs(args):
        return optimistix_root(residual, start, args)

    np.testing.assert_allclose(ours(args), theirs(args), rtol=1e-13)
    for derivative in (jax.jacfwd, jax.jacrev):
        one, other = jax.jit(derivative(ours))(args), jax.jit(derivative(theirs))(args)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-14), one, other)


def test_second_derivatives_of_a_vector_are_differences_of_the_first():
    """Every root is found anew."""
    residual, start, (matrix, right) = PROBLEMS["2 unknowns"]

    def root(right):
        args = matrix, right
        return implicit(residual, jax.lax.stop_gradient(newtons_root(residual, start, args)), args)

    first, second = jax.jit(jax.jacrev(root)), jax.jit(jax.jacfwd(jax.jacrev(root)))(right)
    h = 1e-5
    for k, step in enumerate(h * np.eye(2)):
        by_steps = (first(right + step) - first(right - step)) / (2 * h)
        np.testing.assert_allclose(second[..., k], by_steps, atol=1e-9)
    assert np.max(np.abs(second)) > 1e-2


def quadratic(x, args):
    return x**2 + 2 * args[0] * x - args[1]


def its_root(args):
    return jnp.sqrt(args[0] ** 2 + args[1]) - args[0]


def first_to_third(function):
    """In both modes, and mixed."""

    def derivatives(args):
        fixed = jax.lax.stop_gradient(args)
        of = lambda args: function(args, fixed)  # noqa: E731
        second = jax.jacfwd(jax.grad(of))
        return jax.grad(of)(args), jax.jacfwd(of)(args), second(args), jax.jacrev(jax.jacfwd(of))(args), \
            jax.jacfwd(second)(args)  # fmt: skip

    return jax.jit(derivatives)


attached = first_to_third(lambda args, fixed: implicit(quadratic, its_root(fixed), args))
closed = first_to_third(lambda args, _: its_root(args))


@RANDOM
@given(a=st.floats(-3, 3), target=st.floats(0.05, 4))
def test_closed_forms(a, target):
    """x^2 + 2 a x = target: x = sqrt(a^2 + target) - a, to the third order."""
    args = jnp.array([a, target])
    for ours, theirs in zip(attached(args), closed(args), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9 * np.max(np.abs(theirs)))


def test_where_the_slope_is_zero_a_scalar_root_has_no_derivative():
    """A limit point: zero, beside a lane that has one."""

    def root(c, x):
        return implicit(lambda x, c: x**2 - c, x, c)

    lanes = jnp.array([0.0, 4.0])
    assert jax.vmap(jax.grad(root))(lanes, jnp.sqrt(lanes)).tolist() == [0.0, 0.25]
    assert jax.vmap(lambda c, x: jax.jvp(lambda c: root(c, x), (c,), (1.0,))[1])(lanes, jnp.sqrt(lanes))[0] == 0


def test_the_value_is_what_was_handed_over_and_its_own_derivative_plays_no_part():
    def scene(c):
        return implicit(lambda x, c: x - c**2, 7.0 * c, c)

    assert float(scene(jnp.asarray(3.0))) == 21.0
    assert float(jax.grad(scene)(3.0)) == 6.0


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7])
def test_small_systems_against_numpy(n):
    random = np.random.default_rng(n)
    for _ in range(5):
        matrix, right = random.normal(size=(n, n)), random.normal(size=n)
        found = solve_small(jnp.asarray(matrix), jnp.asarray(right))
        np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-9)


def test_a_known_value_with_the_derivatives_of_its_function():
    calls = []

    def function(args):
        calls.append(1)
        return jnp.sin(args["x"]) * args["y"]

    args = {"x": 0.7, "y": 2.0}
    known = np.sin(0.7) * 2.0
    assert float(jax.jit(lambda args: with_derivatives_of(function, known, args))(args)) == known
    assert not calls  # it is not run for its value
    for derivative in (jax.grad, lambda f: jax.jacfwd(jax.grad(f))):
        ours = jax.jit(derivative(lambda args: with_derivatives_of(function, function(args), args)))(args)
        jax.tree.map(np.testing.assert_allclose, ours, derivative(function)(args))
    assert jax.grad(lambda value: with_derivatives_of(function, value, args))(known) == 0


def test_a_known_value_is_differentiated_in_batches_whatever_axis_they_have():
    matrix = jnp.asarray([[1.0, 2.0, 0.5], [-1.0, 0.3, 4.0]])

    def function(x):
        return matrix @ jnp.sin(x)  # under vmap JAX puts the batch last

    def known(x):
        return jnp.sin(x) @ matrix.T  # and here first

    batched = jax.vmap(jax.jit(lambda x: jnp.where(x[0] > 0, with_derivatives_of(function, known(x), x), 0.0)))
    x = jnp.linspace(0.1, 1.2, 12).reshape(4, 3)
    slopes = jax.jvp(batched, (x,), (jnp.ones_like(x),))[1]
    np.testing.assert_allclose(slopes, np.cos(x) @ matrix.T, rtol=1e-13)
