"""What everything is solved with, against NumPy and closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import legendre

from softgrip_jax.numerics.quadrature import between, gauss_points, integrals, remaining
from softgrip_jax.numerics.small_linear import ELIMINATED, by_square_factors, solve, solve_and_renew, solve_and_sign
from softgrip_jax.numerics.xla import cos_and_sin, differentiated_once, materialised


@pytest.mark.parametrize("n", [2, 3, ELIMINATED, ELIMINATED + 5])
def test_lanes_of_linear_equations_and_the_sign_of_their_determinants(n):
    """In a batch, alone, and with a matrix for all; rows must be exchanged: some pivots are zero."""
    random = np.random.default_rng(n)
    matrices, right = random.normal(size=(70, n, n)), random.normal(size=(70, n, 2))
    matrices[::3, 0, 0] = 0
    matrices[1::3] = matrices[1::3, random.permutation(n)] * 1e3
    x, sign = jax.jit(jax.vmap(solve_and_sign))(matrices, right)
    expected = np.linalg.solve(matrices, right)
    size = np.max(np.abs(expected), axis=(1, 2)) * np.linalg.cond(matrices)
    assert np.all(np.max(np.abs(x - expected), axis=(1, 2)) < 1e-14 * size)
    assert np.array_equal(sign, np.sign(np.linalg.det(matrices)))
    one, its_sign = jax.jit(solve_and_sign)(matrices[0], right[0])
    np.testing.assert_allclose(one, x[0], rtol=1e-9)
    assert its_sign == sign[0]
    same, _ = jax.jit(jax.vmap(solve_and_sign, (None, 0)))(matrices[0], right)
    np.testing.assert_allclose(same[0], one, rtol=1e-9)


@pytest.mark.parametrize("n", [3, ELIMINATED + 5])
def test_an_inverse_is_renewed_where_that_is_wanted(n):
    """In a batch of few unknowns it is always a new one."""
    random = np.random.default_rng(n)
    matrices, right = random.normal(size=(9, n, n)), random.normal(size=(9, n, 2))
    matrices[::3, 0, 0] = 0
    old, wanted = random.normal(size=(9, n, n)), np.arange(9) % 2 == 0
    expected, sign = jax.jit(jax.vmap(solve_and_sign))(matrices, right)
    x, its_sign, inverse = jax.jit(jax.vmap(solve_and_renew))(matrices, right, old, wanted)
    np.testing.assert_allclose(x, expected, rtol=1e-9)
    np.testing.assert_array_equal(its_sign, sign)
    new = wanted if n > ELIMINATED else np.ones(9, bool)
    np.testing.assert_allclose(inverse[new], np.linalg.inv(matrices[new]), rtol=1e-8, atol=1e-10)
    np.testing.assert_array_equal(inverse[~new], old[~new])
    for k in (0, 1):
        x, its_sign, inverse = jax.jit(solve_and_renew)(matrices[k], right[k], old[k], wanted[k])
        np.testing.assert_allclose(x, expected[k], rtol=1e-9)
        assert its_sign == sign[k]
        np.testing.assert_allclose(inverse, np.linalg.inv(matrices[k]) if wanted[k] else old[k], rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize(("n", "k"), [(2, 1), (ELIMINATED + 5, 2), (ELIMINATED + 1, ELIMINATED + 1)])
def test_square_factors_give_the_same(n, k):
    """What a GPU takes for larger systems of a batch."""
    random = np.random.default_rng(n)
    matrices, right = random.normal(size=(9, n, n)), random.normal(size=(9, n, k))
    matrices[::3, 0, 0] = 0
    x, sign = jax.jit(jax.vmap(by_square_factors))(matrices, right)
    expected = np.linalg.solve(matrices, right)
    size = np.max(np.abs(expected), axis=(1, 2)) * np.linalg.cond(matrices)
    assert np.all(np.max(np.abs(x - expected), axis=(1, 2)) < 1e-14 * size)
    assert np.array_equal(sign, np.sign(np.linalg.det(matrices)))
    assert not np.all(sign == sign[0])


@pytest.mark.parametrize("n", [3, ELIMINATED + 1])
def test_a_singular_lane_is_not_finite_and_spoils_no_other(n):
    random = np.random.default_rng(n)
    matrices, right = random.normal(size=(5, n, n)), random.normal(size=(5, n, 1))
    matrices[2] = 0
    x, _ = jax.jit(jax.vmap(solve_and_sign))(matrices, right)
    assert not np.any(np.isfinite(x[2]))
    others = np.array([0, 1, 3, 4])
    np.testing.assert_allclose(x[others], np.linalg.solve(matrices[others], right[others]), rtol=1e-9)


@pytest.mark.parametrize("columns", [(), (3,)])
def test_a_solution_and_its_derivatives_are_those_of_jax(columns):
    """Values, gradients, second derivatives, lanes of lanes."""
    random = np.random.default_rng(len(columns))
    matrices = jnp.asarray(random.normal(size=(7, 5, 5)))
    right = jnp.asarray(random.normal(size=(7, 5, *columns)))

    def everything(solve):
        def of_lane(matrix, right):
            return jnp.sum(jnp.sin(solve(matrix, right)))

        def of_lanes(matrices, right):
            return jnp.sum(jax.vmap(of_lane)(matrices, right))

        slopes = jax.grad(of_lanes, (0, 1))(matrices, right)
        curvature = jax.hessian(of_lane)(matrices[0], right[0])
        by_factor = jax.vmap(lambda f: jax.vmap(solve, (0, None))(matrices, f * right[0]))(jnp.arange(1.0, 4.0))
        return slopes, curvature, by_factor

    found, expected = (jax.jit(everything, static_argnums=0)(one) for one in (solve, jnp.linalg.solve))
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-10 * np.max(np.abs(other)))


def test_what_is_computed_once_has_the_derivatives_that_it_should_have():
    angle = jnp.linspace(-7.0, 7.0, 9)
    cosine, sine = cos_and_sin(angle)
    assert np.max(np.abs(cosine - np.cos(angle))) < 3e-16
    assert np.max(np.abs(sine - np.sin(angle))) < 3e-16
    assert_same_derivatives(lambda x: jnp.stack(cos_and_sin(x)), lambda x: jnp.stack([jnp.cos(x), jnp.sin(x)]), 0.7)
    assert_same_derivatives(lambda x: materialised(x**3), lambda x: x**3, 1.3)

    def both(a):
        return jnp.stack([a[0] * jnp.sin(a[1]), a[1] / a[0]])

    split = differentiated_once(lambda a, b: (a * jnp.sin(b), b / a))
    assert_same_derivatives(lambda a: jnp.stack(split(a[0], a[1])), both, jnp.array([1.3, 0.4]))


def test_numbers_of_arrays_and_arrays_of_numbers_are_differentiated_once():
    def number(matrix, vector, number):
        return {"x": jnp.sum(matrix @ jnp.sin(vector)) * number, "y": number**2 * vector[0] * matrix[1, 0]}

    def array(a, b):
        return jnp.outer(jnp.stack([a, b**2]), jnp.stack([a * b, b, jnp.sin(a)]))

    args = jnp.array([[0.3, -1.0, 0.4], [2.0, 0.7, -0.2]]), jnp.array([0.5, 1.1, -0.6]), jnp.asarray(1.7)
    along = jnp.array([[1.0, 0.2, -3.0], [0.1, 5.0, 0.6]]), jnp.array([-0.4, 0.9, 2.0]), jnp.asarray(0.8)
    for plain, x, direction in ((number, args, along), (array, (0.7, 1.3), (0.2, -0.9))):
        ours, theirs = (jax.jvp(f, x, direction) for f in (differentiated_once(plain), plain))
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-14), ours, theirs)


@pytest.mark.parametrize("apart", [False, True])
def test_many_numbers_are_followed_along_each_direction(apart):
    """A law of forty numbers at a point: the same derivatives, and no slope by each of the forty is worked out."""

    def law(numbers, x, y):
        return jnp.sum(numbers["many"] * jnp.sin(numbers["scale"] * x * jnp.arange(40.0))) * y, x * y

    numbers = {"many": jnp.linspace(-1.0, 2.0, 40), "scale": jnp.asarray(0.3)}
    once = differentiated_once(law, apart=apart)

    def of(law, weights):
        moved = {"many": numbers["many"] * weights[0] + weights[1], "scale": numbers["scale"] * weights[0]}
        return jnp.stack(law(moved, weights[2], weights[0] * weights[1]))

    weights = jnp.array([0.9, 1.2, -0.7])
    assert_same_derivatives(lambda w: of(once, w), lambda w: of(law, w), weights)
    # Nothing moves: the value alone.
    np.testing.assert_array_equal(jnp.stack(once(numbers, 0.5, 2.0)), jnp.stack(law(numbers, 0.5, 2.0)))
    slopes = jax.jit(jax.grad(lambda many: once({"many": many, "scale": jnp.asarray(0.3)}, 0.5, 2.0)[0]))
    assert "tensor<40x40xf64>" not in slopes.lower(numbers["many"]).as_text()
    np.testing.assert_allclose(slopes(numbers["many"]), 2 * np.sin(0.15 * np.arange(40.0)), rtol=1e-14)


def test_arrays_of_arrays_are_differentiated_once():
    """y = A x and y = x^2 elementwise, whose slopes are A and 2 x on the diagonal."""
    matrix, x = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]), jnp.array([0.5, -2.0])
    once = differentiated_once(lambda x: (matrix @ x, x**2))
    first, second = jax.jit(jax.jacfwd(once))(x)
    np.testing.assert_allclose(first, matrix, rtol=1e-15)
    np.testing.assert_allclose(second, np.diag(2 * np.asarray(x)), rtol=1e-15)


def test_what_does_not_move_is_not_differentiated():
    """a sqrt(b) at b = 0 has no slope by b, and one by a."""
    split = differentiated_once(lambda a, b: a * jnp.sqrt(b))
    assert jax.jvp(lambda a: split(a, jnp.asarray(0.0)), (3.0,), (1.0,))[1] == 0
    assert jax.jvp(lambda b: split(3.0, b), (4.0,), (1.0,))[1] == 0.75


def assert_same_derivatives(guarded, plain, x):
    """Of the first three orders, the first in both modes."""
    fwd = jax.jacfwd
    for of in (fwd, jax.jacrev, lambda f: jax.jacrev(fwd(f)), lambda f: fwd(jax.jacrev(f)), lambda f: fwd(fwd(fwd(f)))):
        np.testing.assert_allclose(jax.jit(of(guarded))(x), jax.jit(of(plain))(x), rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("parts", [1, 4])
def test_integrals_along_a_line_of_parts(parts):
    """Of a polynomial that the points know exactly, from the beginning and to the end."""
    points, coefficients = gauss_points(6), np.random.default_rng(parts).normal(size=6)
    bounds = np.concatenate([[0.0], np.sort(np.random.default_rng(1).random(parts - 1)), [1.0]])
    widths = np.diff(bounds)
    places = bounds[:-1, None] + widths[:, None] * points.places
    whole = legendre.legint(coefficients, lbnd=0.0)
    values = jnp.asarray(legendre.legval(places, coefficients))
    up_to, ends = integrals(values, jnp.asarray(widths), points)
    np.testing.assert_allclose(up_to, legendre.legval(places, whole), atol=1e-14)
    np.testing.assert_allclose(ends, legendre.legval(bounds[1:], whole), atol=1e-14)
    rest = legendre.legval(1.0, whole) - legendre.legval(places, whole)
    np.testing.assert_allclose(remaining(values, jnp.asarray(widths), points), rest, atol=1e-14)


def test_a_place_between_points_has_the_value_and_the_integral_of_their_polynomial():
    """Of a polynomial that the points know exactly, at any place of any part."""
    points, random = gauss_points(5), np.random.default_rng(3)
    coefficients = random.normal(size=(2, 5))
    values = jnp.stack([jnp.asarray(legendre.legval(2 * points.places - 1, c)) for c in coefficients])
    at = jax.jit(jax.vmap(lambda place, part: between(values, place, part, points)))
    places, parts = np.array([0.0, 0.13, 0.5, 1.0, 0.77]), np.array([0, 1, 1, 0, 0])
    found, integral = at(places, parts)
    for k, part in enumerate(parts):
        x = 2 * places[k] - 1
        assert float(found[k]) == pytest.approx(legendre.legval(x, coefficients[part]), abs=1e-14)
        whole = legendre.legval(x, legendre.legint(coefficients[part], lbnd=-1)) / 2
        assert float(integral[k]) == pytest.approx(whole, abs=1e-14)
