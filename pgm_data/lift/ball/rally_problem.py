"""The nonlinear programme of a rally's fit, built once for each pattern.

Its derivatives are put together from those of its small parts, block by block, so that building takes milliseconds:
constraints (each interval's flow ends where the next begins) have exact Jacobians, the cost has its Gauss-Newton
Hessian.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from pgm_data.lift.ball.flight_model import (
    CAMERA_NUMBERS,
    between_function,
    bounce_function,
    end_function,
    flow_function,
    mark_function,
    sighting_function,
)
from pgm_data.lift.ball.rally_layout import RallyLayout, RallyPattern


@dataclass(frozen=True, eq=False, kw_only=True)
class RallyData:
    """What a rally's fit is given, in the order of its pattern."""

    scale: Float[np.ndarray, " unknowns"]
    """An unknown is this times the solver's variable."""
    prior_mean: Float[np.ndarray, " unknowns"]
    prior_precision: Float[np.ndarray, " unknowns"]
    """One over variance; 0 without a prior."""
    node_times: Float[np.ndarray, " nodes"]
    """Seconds, on the clock of the contact times."""
    node_camera: Float[np.ndarray, "nodes 20"]
    node_pixel: Float[np.ndarray, "nodes 2"]
    node_precision: Float[np.ndarray, " nodes"]
    """1/px^2; 0 where there is no measurement."""
    between_delay: Float[np.ndarray, " between"]
    """Seconds after its node; the frames after each node, node after node."""
    between_camera: Float[np.ndarray, "between 20"]
    between_pixel: Float[np.ndarray, "between 2"]
    between_precision: Float[np.ndarray, " between"]
    mark_camera: Float[np.ndarray, "contacts 20"]
    mark_pixel: Float[np.ndarray, "contacts 2"]
    mark_precision: Float[np.ndarray, " contacts"]
    bounce_std: Float[np.ndarray, "bounces 3"]
    """Departures from the bounce law: normal speed, tangential velocity (m/s), spin (rad/s)."""
    bend: float
    """Where the robust loss bends, standard deviations."""

    def packed(self, pattern: RallyPattern) -> Float[np.ndarray, " numbers"]:
        """All of it in one vector, as the functions read it."""
        parts = [self.scale, self.prior_mean, self.prior_precision, self.node_times]
        parts += [self.node_camera.ravel(), self.node_pixel.ravel(), self.node_precision]
        if pattern.between:
            parts += [self.between_delay, self.between_camera.ravel(), self.between_pixel.ravel()]
            parts += [self.between_precision]
        if pattern.marks:
            parts += [self.mark_camera.ravel(), self.mark_pixel.ravel(), self.mark_precision]
        return np.concatenate([*parts, self.bounce_std.ravel(), [self.bend]])


@dataclass(frozen=True, eq=False, kw_only=True)
class RallyProblem:
    """A pattern's programme and its parts."""

    layout: RallyLayout
    solver: Any
    """CasADi nlpsol."""
    cost: Any
    """Function of variables and data: the cost and its gradient."""
    constraints: Any
    """The constraints and their Jacobian."""
    curvature: Any
    """Upper triangle of the cost's Gauss-Newton Hessian."""


@dataclass(frozen=True)
class SolverOptions:
    """How IPOPT runs."""

    iterations: int = 60
    """Most iterations."""
    tolerance: float = 1e-5
    """Of the scaled optimality conditions."""
    barrier: float = 1e-3
    """Where the barrier starts."""


@lru_cache(maxsize=48)
def rally_problem(pattern: RallyPattern, options: SolverOptions) -> RallyProblem:
    """The programme of a pattern; kept, as rallies cut into shots share theirs."""
    import casadi as ca

    layout = RallyLayout(pattern=pattern)
    parts = _Parts(layout)
    x, p = parts.x, parts.p
    cost, gradient = parts.cost()
    value, jacobian = parts.constraints()
    curvature = parts.curvature()
    named = {"x": x, "p": p, "f": cost, "g": parts.defects()}
    factor, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", value.shape[0])
    grad_f = ca.Function("grad_f", [x, p], [cost, gradient], ["x", "p"], ["f", "grad_f_x"])
    jac_g = ca.Function("jac_g", [x, p], [value, jacobian], ["x", "p"], ["g", "jac_g_x"])
    hess = ca.Function(
        "hess_lag",
        [x, p, factor, multipliers],
        [factor * curvature],
        ["x", "p", "lam_f", "lam_g"],
        ["triu_hess_gamma_x_x"],
    )
    solver = ca.nlpsol(
        "rally",
        "ipopt",
        named,
        {
            "grad_f": grad_f,
            "jac_g": jac_g,
            "hess_lag": hess,
            "no_nlp_grad": True,
            "calc_lam_p": False,
            "print_time": False,
            "error_on_fail": False,
            "show_eval_warnings": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "max_iter": options.iterations,
                "tol": options.tolerance,
                # Gauss-Newton steps under a robust loss shrink slowly at the end: it is over once the cost, which is in
                # nats, has stood still for some steps.
                "acceptable_tol": 1e3,
                "acceptable_dual_inf_tol": 1e3,
                "acceptable_constr_viol_tol": 1e-4,
                "acceptable_obj_change_tol": 1e-2 * options.tolerance,
                "acceptable_iter": 3,
                "mu_init": options.barrier,
                "bound_relax_factor": 0.0,
                "nlp_scaling_method": "none",
                "fixed_variable_treatment": "make_parameter",
            },
        },
    )
    return RallyProblem(
        layout=layout,
        solver=solver,
        cost=grad_f,
        constraints=jac_g,
        curvature=ca.Function("curvature", [x, p], [curvature]),
    )


class _Parts:
    """Symbols of one pattern, and its cost and constraints in terms of them."""

    def __init__(self, layout: RallyLayout) -> None:
        import casadi as ca

        self.layout, self.pattern = layout, layout.pattern
        nodes, contacts, between = sum(self.pattern.nodes), layout.contacts, sum(self.pattern.nodes)
        between *= self.pattern.between
        n = layout.size
        self.x = ca.MX.sym("x", n)
        sizes = {"scale": n, "mean": n, "precision": n, "times": nodes}
        sizes |= {"node_camera": nodes * CAMERA_NUMBERS, "node_pixel": 2 * nodes, "node_precision": nodes}
        if between:
            sizes |= {"delay": between, "camera": between * CAMERA_NUMBERS, "pixel": 2 * between, "weight": between}
        if self.pattern.marks:
            sizes |= {"mark_camera": contacts * CAMERA_NUMBERS, "mark_pixel": 2 * contacts, "mark_weight": contacts}
        sizes |= {"std": 3 * len(layout.bounce), "bend": 1}
        self.p = ca.MX.sym("p", sum(sizes.values()))
        ends = np.concatenate([[0], np.cumsum(list(sizes.values()))]).tolist()
        self.given = {name: self.p[a:b] for name, a, b in zip(sizes, ends[:-1], ends[1:], strict=True)}
        self.y = self.x * self.given["scale"]

    def columns(self, places: Int[np.ndarray, "rows width"]):
        """Unknowns at those places, a column a row."""
        import casadi as ca

        flat = places.ravel().tolist()
        return ca.reshape(self.y[flat], places.shape[1], places.shape[0]) if flat else ca.MX(places.shape[1], 0)

    def _table(self, name: str, width: int):
        import casadi as ca

        values = self.given[name]
        return ca.reshape(values, width, values.shape[0] // width)

    def _blocks(self) -> list[tuple[np.ndarray, Any]]:
        """Parts of the cost: places of their unknowns, and their costs, gradients and Hessians in columns."""
        layout, pattern, bend = self.layout, self.pattern, self.given["bend"]
        blocks = []
        at = layout.node[:, :3]
        if len(at):
            f = sighting_function().map(len(at))
            camera = self._table("node_camera", CAMERA_NUMBERS)
            seen = self._table("node_pixel", 2)
            blocks.append((at, f(self.columns(at), camera, seen, self.given["node_precision"].T, bend)))
        if pattern.between and len(at):
            flight = np.repeat(layout.node_flight, pattern.between)
            state = np.repeat(layout.node, pattern.between, axis=0)
            at = np.concatenate([state, layout.spin[flight], np.full((len(flight), 1), layout.drag)], axis=1)
            f = between_function(pattern.law, pattern.steps).map(len(at))
            values = f(
                self.columns(state),
                self.columns(layout.spin[flight]),
                self.y[layout.drag],
                self.given["delay"].T,
                self._table("camera", CAMERA_NUMBERS),
                self._table("pixel", 2),
                self.given["weight"].T,
                bend,
            )
            blocks.append((at, values))
        if pattern.marks:
            at = layout.position[:, :2]
            f = mark_function().map(len(at))
            camera, pixel = self._table("mark_camera", CAMERA_NUMBERS), self._table("mark_pixel", 2)
            blocks.append((at, f(self.columns(at), camera, pixel, self.given["mark_weight"].T, bend)))
        at = layout.bounce_unknowns
        if len(at):
            f = bounce_function(pattern.law.radius_m).map(len(at))
            parts = [self.columns(at[:, i : i + 3]) for i in (0, 3, 6, 9)]
            shared = [self.y[layout.restitution], self.y[layout.friction]]
            blocks.append((at, f(*parts, *shared, self._table("std", 3))))
        return blocks

    def cost(self) -> tuple[Any, Any]:
        """The cost and its gradient."""
        import casadi as ca

        off = self.y - self.given["mean"]
        blocks = self._blocks()
        total = ca.dot(self.given["precision"] * off, off) / 2
        for _, (cost, _, _) in blocks:
            total += ca.sum2(cost)
        places = np.concatenate([np.zeros(0, dtype=int), *(at.ravel() for at, _ in blocks)])
        values = ca.vertcat(*[ca.vec(g) for _, (_, g, _) in blocks])
        gradient = _sums(places, self.layout.size) @ values + self.given["precision"] * off
        return total, gradient * self.given["scale"]

    def curvature(self):
        """Upper triangle of the Gauss-Newton Hessian, sparse."""
        import casadi as ca

        n = self.layout.size
        rows, columns = [np.arange(n)], [np.arange(n)]
        values = [self.given["precision"]]
        for at, (_, _, H) in self._blocks():
            j, i = np.tril_indices(at.shape[1])
            a, b = at[:, i].ravel(), at[:, j].ravel()
            rows.append(np.minimum(a, b))
            columns.append(np.maximum(a, b))
            values.append(ca.vec(H))
        row, column = np.concatenate(rows), np.concatenate(columns)
        keys, place = np.unique(column * n + row, return_inverse=True)
        scale = self.given["scale"]
        entries = _sums(place, len(keys)) @ ca.vertcat(*values)
        entries = entries * scale[(keys % n).tolist()] * scale[(keys // n).tolist()]
        return _sparse(n, n, keys, entries)

    def _durations(self):
        times = self.layout.interval_times
        import casadi as ca

        clock = ca.vertcat(self.columns(self.layout.time[:, None]).T, self.given["times"])
        return (clock[times[:, 1].tolist()] - clock[times[:, 0].tolist()]).T

    def _flown(self, function):
        layout = self.layout
        f = function(self.pattern.law, self.pattern.steps).map(len(layout.interval_from))
        spin = self.columns(layout.spin[layout.interval_flight])
        return f(self.columns(layout.interval_from), spin, self.y[layout.drag], self._durations())

    def defects(self):
        """By how much each interval's flow misses the next node."""
        import casadi as ca

        return ca.vec(self._flown(end_function) - self.columns(self.layout.interval_to))

    def constraints(self) -> tuple[Any, Any]:
        """The defects and their sparse Jacobian."""
        import casadi as ca

        layout = self.layout
        end, J = self._flown(flow_function)
        count, n = len(layout.interval_from), layout.size
        row = np.arange(6 * count).reshape(count, 6)
        # J is 6 x 11 an interval, side by side: its entries run down the columns, interval after interval.
        wide = np.concatenate(
            [
                layout.interval_from,
                layout.spin[layout.interval_flight],
                np.full((count, 1), layout.drag),
            ],
            axis=1,
        )
        source = np.arange(66 * count).reshape(count, 11, 6)
        rows = [np.repeat(row[:, None], 10, axis=1).ravel(), row.ravel()]
        columns = [np.repeat(wide[:, :, None], 6, axis=2).ravel(), layout.interval_to.ravel()]
        sources = [source[:, :10].ravel(), np.full(6 * count, 66 * count)]
        signs = [np.ones(60 * count), -np.ones(6 * count)]
        for side, sign in ((0, -1.0), (1, 1.0)):
            known = layout.interval_times[:, side]
            free = known < layout.contacts
            rows.append(row[free].ravel())
            columns.append(np.repeat(layout.time[known[free]], 6))
            sources.append(source[free, 10].ravel())
            signs.append(np.full(6 * int(free.sum()), sign))
        row_all, column_all = np.concatenate(rows), np.concatenate(columns)
        keys = column_all * (6 * count) + row_all
        order = np.argsort(keys)
        taken = ca.vertcat(ca.vec(J), 1)[np.concatenate(sources)[order].tolist()]
        entries = taken * ca.DM(np.concatenate(signs)[order]) * self.given["scale"][column_all[order].tolist()]
        return ca.vec(end - self.columns(layout.interval_to)), _sparse(6 * count, n, keys[order], entries)


def _sums(places: Int[np.ndarray, " values"], size: int):
    """The sparse matrix that adds each value up at its place."""
    import casadi as ca

    columns = np.arange(len(places))
    return ca.DM.triplet(places.tolist(), columns.tolist(), ca.DM.ones(len(places)), size, len(places))


def _sparse(rows: int, columns: int, keys: Int[np.ndarray, " entries"], entries):
    """A sparse matrix of entries at column * rows + row, in rising order."""
    import casadi as ca

    starts = np.searchsorted(keys // rows, np.arange(columns + 1))
    return ca.MX(ca.Sparsity(rows, columns, starts.tolist(), (keys % rows).tolist()), entries)
