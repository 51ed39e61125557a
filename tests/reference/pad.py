"""A bonded gel pad under a rigid ball: scikit-fem's elements, quadrature and assembly.

* Neo-Hookean solid W = μ/2 (I₁ − 3) − μ ln J + λ/2 (ln J)².
* Pressure p = k δ at depth δ, k = E / softness, at the quadrature points of the upper faces.
* Coulomb friction: a spring h = k/4 to the place on the ball where the point sticks, cut at μp.

Sparse solver: PARDISO of Intel's MKL. Shapes: N nodes of the element, T tetrahedra, F faces,
Q quadrature points; fields are (3, N), or (3, T, Q) and (3, F, Q). SI units.
"""

import numpy as np
import pypardiso
import scipy.sparse as sp
import skfem
from skfem import Basis, BilinearForm, FacetBasis, LinearForm
from skfem.helpers import det, dot, grad, inv

MM = 1e-3
YOUNG, POISSON = 2e5, 0.48
MU = YOUNG / (2 * (1 + POISSON))
LAMBDA = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
RADIUS = 4 * MM
TOLERANCE, ITERATIONS, SHORTEST = 1e-7, 30, 1e-6
ELEMENTS = {"p1": (skfem.ElementTetP1(), 1), "p2": (skfem.ElementTetP2(), 2)}


@LinearForm
def load(v, w):
    """Virtual work of a traction's component."""
    return w.traction * v


@BilinearForm
def spring(u, v, w):
    """Virtual work of a surface stiffness' component."""
    return w.stiffness * u * v


@LinearForm
def internal(v, w):
    """Virtual work of a row of the first Piola–Kirchhoff stress."""
    return dot(w.stress, grad(v))


@BilinearForm
def tangent(u, v, w):
    """Block (i, k) of the linearised `internal`; a and b are rows i and k of F⁻ᵀ."""
    du, dv = grad(u), grad(v)
    symmetric = w.shear * dot(w.a, du) * dot(w.b, dv) + LAMBDA * dot(w.a, dv) * dot(w.b, du)
    return symmetric + MU * dot(du, dv) if w.diagonal else symmetric


class Solid:
    """The pad in one element: its elastic forces and stiffness."""

    def __init__(self, mesh, element, order):
        self.basis = Basis(mesh, element, intorder=order)
        bottom = mesh.facets_satisfying(lambda x: x[2] < -3.999 * MM)
        self.fixed = self.basis.get_dofs(bottom).all()

    def gradient(self, u):
        """Deformation gradient (3, 3, T, Q) of nodal displacements (3, N)."""
        rows = [self.basis.interpolate(component).grad for component in u]
        return np.array(rows) + np.eye(3)[:, :, None, None]

    def stress(self, f):
        """First Piola–Kirchhoff stress (3, 3, T, Q)."""
        g = np.swapaxes(inv(f), 0, 1)
        return MU * (f - g) + LAMBDA * np.log(det(f)) * g

    def force(self, f):
        """Internal force on the nodes (3, N)."""
        return np.array([internal.assemble(self.basis, stress=row) for row in self.stress(f)])

    def energy(self, f):
        """Elastic energy (J)."""
        log_j = np.log(det(f))
        density = MU / 2 * (np.sum(f**2, axis=(0, 1)) - 3) - MU * log_j + LAMBDA / 2 * log_j**2
        return np.sum(density * self.basis.dx)

    def stiffness(self, f):
        """Element matrices of the nine pairs of components, (3, 3, ...) flattened."""
        g, shear = np.swapaxes(inv(f), 0, 1), MU - LAMBDA * np.log(det(f))
        nodes, blocks = self.basis.Nbfun, [[None] * 3 for _ in range(3)]
        for i in range(3):
            for k in range(i, 3):
                fields = {"a": g[i], "b": g[k], "shear": shear, "diagonal": int(i == k)}
                data = tangent.elemental(self.basis, **fields).data
                blocks[i][k] = data
                blocks[k][i] = data.reshape(nodes, nodes, -1).swapaxes(0, 1).ravel()
        return np.concatenate([data for row in blocks for data in row])

    def von_mises(self, u):
        """Von Mises equivalent of the Cauchy stress, mean over each tetrahedron (T)."""
        f = self.gradient(u)
        cauchy = np.einsum("iK...,jK...->ij...", self.stress(f), f) / det(f)
        deviator = cauchy - np.trace(cauchy) / 3 * np.eye(3)[:, :, None, None]
        local = np.sqrt(1.5 * np.sum(deviator**2, axis=(0, 1)))
        return np.sum(local * self.basis.dx, axis=1) / np.sum(self.basis.dx, axis=1)


def outer(a, b):
    """Outer products of two fields of vectors (3, F, Q)."""
    return a[:, None] * b[None, :]


class Contact:
    """A rigid ball on the upper face: tractions at its quadrature points (F, Q)."""

    def __init__(self, mesh, element, order, friction, softness):
        top = mesh.facets_satisfying(lambda x: x[2] > -1e-9, boundaries_only=True)
        self.basis = FacetBasis(mesh, element, facets=top, intorder=order)
        self.rest = np.asarray(self.basis.global_coordinates())
        self.friction, self.k = friction, YOUNG / softness
        self.h = self.k / 4
        self.stuck = np.full(self.rest.shape, np.nan)
        self.entry = self.stuck

    def places(self, u):
        """Positions of the points (3, F, Q)."""
        return self.rest + np.array([self.basis.interpolate(component) for component in u])

    def begin(self, u, start, end):
        """Opens a load step of the ball's centre: a point that it meets sticks where they meet."""
        way, travel = self.places(u) - start[:, None, None], end - start
        # |way − t travel| = R: the earlier root, within the step.
        a, b = travel @ travel, np.einsum("i,ifq->fq", travel, way)
        c = np.sum(way**2, axis=0) - RADIUS**2
        root = (b - np.sqrt(np.maximum(b * b - a * c, 0))) / a
        meets = (b * b > a * c) & (root >= 0) & (root <= 1)
        t = np.where(c <= 0, 0, np.where(meets, root, 1))
        met = way - t * travel[:, None, None]
        self.entry = np.where(np.isnan(self.stuck), met, self.stuck)

    def state(self, u, centre):
        """Depth (F, Q), normal and slip (3, F, Q), and the ball's traction on the pad."""
        way = self.places(u) - centre[:, None, None]
        distance = np.linalg.norm(way, axis=0)
        depth, normal = np.maximum(RADIUS - distance, 0), way / distance
        slip = way - self.entry
        slip = slip - normal * np.sum(normal * slip, axis=0)
        length = np.maximum(np.linalg.norm(slip, axis=0), 1e-300)
        drag = np.minimum(self.h, self.friction * self.k * depth / length)
        return depth, normal, slip, self.k * depth * normal - drag * slip

    def end(self, u, centre):
        """Closes a load step: touching points stick where their springs keep their force."""
        depth, normal, _, traction = self.state(u, centre)
        tangential = traction - normal * np.sum(normal * traction, axis=0)
        way = self.places(u) - centre[:, None, None]
        self.stuck = np.where(depth > 0, way + tangential / self.h, np.nan)

    def force(self, traction):
        """External force on the nodes (3, N)."""
        return np.array([load.assemble(self.basis, traction=component) for component in traction])

    def limit(self, u, centre):
        """Friction that the points bear (F, Q) (Pa)."""
        return self.friction * self.k * self.state(u, centre)[0]

    def energy(self, u, centre, limit):
        """Energy of both springs (J), friction cut at `limit`."""
        depth, _, slip, _ = self.state(u, centre)
        length = np.linalg.norm(slip, axis=0)
        sliding = limit * (length - limit / (2 * self.h))
        tangential = np.where(self.h * length <= limit, self.h * length**2 / 2, sliding)
        return np.sum((self.k * depth**2 / 2 + tangential * (depth > 0)) * self.basis.dx)

    def total(self, u, centre):
        """Resultant on the pad (3)."""
        return np.sum(self.state(u, centre)[3] * self.basis.dx, axis=(1, 2))

    def stiffness(self, u, centre):
        """Face matrices of −∂traction/∂u for the nine pairs of components."""
        depth, normal, slip, _ = self.state(u, centre)
        length = np.maximum(np.linalg.norm(slip, axis=0), 1e-300)
        limit, touching = self.friction * self.k * depth, depth > 0
        slips, along = self.h * length > limit, slip / length
        across = np.eye(3)[:, :, None, None] - outer(normal, normal)
        matrix = self.k * outer(normal, normal) - self.k * depth / RADIUS * across
        sliding = limit / length * (across - outer(along, along))
        sliding -= self.friction * self.k * outer(along, normal)
        if self.friction > 0:
            matrix = matrix + np.where(slips, sliding, self.h * across)
        blocks = (matrix * touching).reshape(9, *depth.shape)
        return np.concatenate([spring.elemental(self.basis, stiffness=b).data for b in blocks])


class Matrix:
    """The stiffness matrix of the free unknowns: its pattern and PARDISO's analysis are kept.

    Unknown 3n + i is component i at node n. `symmetric` ones are stored and factorised by halves.
    """

    def __init__(self, bases, fixed, symmetric):
        size = 3 * bases[0].N
        free = np.ones(size, bool)
        free[(3 * fixed[:, None] + np.arange(3)).ravel()] = False
        number = np.cumsum(free) - 1
        pairs = [self.pairs(basis) for basis in bases]
        rows, cols = (np.concatenate(part) for part in zip(*pairs, strict=True))
        self.kept = free[rows] & free[cols] & ((rows <= cols) | (not symmetric))
        keys = number[rows[self.kept]] * size + number[cols[self.kept]]
        keys, self.slots = np.unique(keys, return_inverse=True)
        self.csr = sp.csr_matrix((np.ones(len(keys)), (keys // size, keys % size)))
        self.free, self.solver = free, pypardiso.PyPardisoSolver(mtype=-2 if symmetric else 11)
        self.analysed = False

    @staticmethod
    def pairs(basis):
        """Rows and columns of the entries that `elemental` gives for nine pairs of components."""
        dofs, count = basis.element_dofs, basis.Nbfun
        rows = np.broadcast_to(dofs[None, :, :], (count, count, dofs.shape[1])).ravel()
        cols = np.broadcast_to(dofs[:, None, :], (count, count, dofs.shape[1])).ravel()
        blocks = [(3 * rows + i, 3 * cols + k) for i in range(3) for k in range(3)]
        return tuple(np.concatenate(part) for part in zip(*blocks, strict=True))

    def solve(self, entries, right):
        """Solution for a right side (3, N), zero where fixed."""
        self.csr.data = np.bincount(self.slots, weights=np.concatenate(entries)[self.kept])
        solution = np.zeros(right.size)
        right = right.T.ravel()[self.free]
        # PARDISO's phases: 1 analysis, 2 factorisation, 3 solution; `solve` would repeat the first.
        self.solver.set_phase(23 if self.analysed else 13)
        solution[self.free] = self.solver._call_pardiso(self.csr, right)
        self.analysed = True
        return solution.reshape(-1, 3).T


class Press:
    """The pad and the ball, led step by step by Newton's method."""

    def __init__(self, mesh, element, friction, settings):
        kind, order = ELEMENTS[element]
        self.solid = Solid(mesh, kind, settings.order or order)
        self.contact = Contact(mesh, kind, settings.face_order, friction, settings.softness)
        bases = (self.solid.basis, self.contact.basis)
        self.matrix = Matrix(bases, self.solid.fixed, symmetric=friction == 0)
        self.u = np.zeros((3, self.solid.basis.N))
        self.rate = np.zeros_like(self.u)
        self.centre = np.array([0, 0, RADIUS])
        self.iterations, self.residual = 0, 0.0

    def unbalanced(self, u, centre):
        """Force left on the nodes (3, N), 0 where fixed, or None if an element is inverted."""
        f = self.solid.gradient(u)
        if det(f).min() <= 0:
            return None
        traction = self.contact.state(u, centre)[3]
        left = self.contact.force(traction) - self.solid.force(f)
        left[:, self.solid.fixed] = 0
        return left

    def predicted(self, centre):
        """Extrapolation of the last step's motion, if less force is unbalanced there than here."""
        onward = self.u + self.rate * np.linalg.norm(centre - self.centre)
        here, ahead = (self.unbalanced(u, centre) for u in (self.u, onward))
        if ahead is not None and np.linalg.norm(ahead) < np.linalg.norm(here):
            return onward, ahead
        return self.u, here

    def equilibrium(self, centre):
        """The displacement (3, N) that balances all forces, or None."""
        u, left = self.predicted(centre)
        for _ in range(ITERATIONS):
            self.residual = np.linalg.norm(left)
            if self.residual <= TOLERANCE:
                return u
            self.iterations += 1
            f = self.solid.gradient(u)
            entries = self.solid.stiffness(f), self.contact.stiffness(u, centre)
            found = self.search(u, self.matrix.solve(entries, left), centre)
            if found is None:
                return None
            u, left = found
        return None

    def search(self, u, step, centre):
        """Halves `step` until it lowers the unbalanced force or the energy at fixed limits."""
        limit = self.contact.limit(u, centre)

        def energy(u):
            return self.solid.energy(self.solid.gradient(u)) + self.contact.energy(u, centre, limit)

        before = energy(u)
        for halves in range(14):
            trial = u + step / 2**halves
            left = self.unbalanced(trial, centre)
            if left is None:
                continue
            if np.linalg.norm(left) < self.residual or energy(trial) < before:
                return trial, left
        return None

    def lead(self, centre):
        """Leads the ball to `centre`, by halves where it must."""
        travel = np.linalg.norm(centre - self.centre)
        self.contact.begin(self.u, self.centre, centre)
        u = self.equilibrium(centre)
        if u is not None:
            self.contact.end(u, centre)
            self.rate = (u - self.u) / travel
            self.u, self.centre = u, centre
        elif travel < SHORTEST:
            raise RuntimeError(f"no equilibrium at {centre} m, residual {self.residual:.2e} N")
        else:
            self.lead((self.centre + centre) / 2)
            self.lead(centre)
