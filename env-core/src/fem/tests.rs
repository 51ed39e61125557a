//! Linear elasticity of the elements against exact and published solutions, and global balance.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use super::{
    Fem, FemOptions,
    element::{Element, Nodes, barycentric, quadratic_gradients},
    examples::grid,
    patches::faces,
    pattern::Pattern,
    solid::{Solid, Strain, solid},
};
use crate::{
    deformation::{Law, Moduli, Press, SoftBody},
    geometry::{EDGES, FACES, Shape, TetMesh},
};

/// A linear elastic body in one discretisation.
struct Problem {
    mesh: TetMesh,
    nodes: Nodes,
    solid: Box<dyn Solid>,
    pattern: Pattern,
    element: Element,
}

impl Problem {
    fn new(
        mesh: TetMesh,
        moduli: Moduli,
        element: Element,
        held: impl Fn(&Point3<f64>) -> bool,
    ) -> Self {
        let fixed: Vec<u32> =
            (0u32..).zip(&mesh.vertices).filter(|(_, x)| held(x)).map(|(n, _)| n).collect();
        let body = SoftBody::new(mesh.clone(), Law::Linear, moduli, &fixed).unwrap();
        let nodes = Nodes::new(&body, element);
        let solid = solid(&body, &nodes, element);
        let pattern = Pattern::new(&nodes.places, &nodes.fixed, &solid.couplings());
        Self { mesh, nodes, solid, pattern, element }
    }

    /// Displacement under nodal `loads` (N) that is `given` at fixed nodes. A `brace` resists every
    /// node's displacement (N/m).
    fn solve(
        &self,
        given: impl Fn(&Point3<f64>) -> Vector3<f64>,
        loads: &[Vector3<f64>],
        brace: &Matrix3<f64>,
    ) -> Vec<Vector3<f64>> {
        let at_fixed = |(x, &fixed)| if fixed { given(x) } else { Vector3::zeros() };
        let mut u: Vec<_> = self.nodes.places.iter().zip(&self.nodes.fixed).map(at_fixed).collect();
        let (mut strain, mut forces) = (Strain::default(), vec![Vector3::zeros(); u.len()]);
        self.solid.evaluate(&u, &mut strain, &mut forces).unwrap();
        let mut matrix = self.pattern.matrix();
        self.solid.assemble(&strain, &self.solid.assembly_map(&self.pattern), &mut matrix, false);
        for node in 0..self.nodes.places.len() as u32 {
            self.pattern
                .position(node, node)
                .into_iter()
                .for_each(|position| matrix.add(position, brace));
        }
        assert!(matrix.factorise(&self.pattern));
        let missing: Vec<_> = loads.iter().zip(&forces).map(|(load, force)| load - force).collect();
        let mut step = self.pattern.gather(&missing);
        matrix.solve(&self.pattern, &mut step);
        u.iter_mut().zip(self.pattern.scatter(&step)).for_each(|(u, du)| *u += du);
        u
    }

    /// Nodes of a tetrahedron: corners, then for `p2` the middles of its edges.
    fn cell(&self, tet: [u32; 4]) -> Vec<u32> {
        let mut cell = tet.to_vec();
        if self.element == Element::P2 {
            cell.extend(EDGES.map(|[a, b]| self.nodes.middle(tet[a], tet[b])));
        }
        cell
    }

    /// Norms of the error of `u` against `exact`: of its values, and of its gradients.
    fn error(&self, u: &[Vector3<f64>], exact: impl Fn(&Point3<f64>) -> Vector3<f64>) -> [f64; 2] {
        let (mut value_error, mut gradient_error) = (0.0, 0.0);
        for &tet in &self.mesh.tets {
            let corners = tet.map(|n| self.mesh.vertices[n as usize]);
            let (slopes, volume) = barycentric(corners);
            let cell = self.cell(tet);
            for (l, weight) in conical_rule() {
                let x =
                    Point3::from((0..4).map(|i| corners[i].coords * l[i]).sum::<Vector3<f64>>());
                let (mut value, mut gradient) = (exact(&x), slope(&exact, &x));
                for (&node, (n, g)) in cell.iter().zip(shape_functions(self.element, &l, &slopes)) {
                    value -= u[node as usize] * n;
                    gradient -= u[node as usize] * g.transpose();
                }
                value_error += weight * volume * value.norm_squared();
                gradient_error += weight * volume * gradient.norm_squared();
            }
        }
        [value_error.sqrt(), gradient_error.sqrt()]
    }
}

/// Shape functions and their gradients (1/m) at barycentric coordinates `l` of gradients `slopes`.
fn shape_functions(
    element: Element,
    l: &[f64; 4],
    slopes: &[Vector3<f64>; 4],
) -> Vec<(f64, Vector3<f64>)> {
    if element != Element::P2 {
        return l.iter().copied().zip(*slopes).collect();
    }
    let corners = l.iter().map(|l| l * (2.0 * l - 1.0));
    let middles = EDGES.iter().map(|&[a, b]| 4.0 * l[a] * l[b]);
    corners.chain(middles).zip(quadratic_gradients(l, slopes)).collect()
}

/// Barycentric points and weights, exact for polynomials of degree 5: four Gauss points along each
/// edge of a cube that is collapsed into the tetrahedron.
fn conical_rule() -> impl Iterator<Item = ([f64; 4], f64)> {
    const GAUSS: [(f64, f64); 4] = [
        (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
        (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
        (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
        (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
    ];
    (0..64).map(|i| {
        let [(u, p), (v, q), (w, r)] = [i / 16, i / 4 % 4, i % 4].map(|k| GAUSS[k]);
        let [b, c, d] = [u, v * (1.0 - u), w * (1.0 - u) * (1.0 - v)];
        let weight = 6.0 * p * q * r * (1.0 - u).powi(2) * (1.0 - v);
        ([1.0 - b - c - d, b, c, d], weight)
    })
}

/// Gradient of a smooth field whose length scale is 1 m.
fn slope(field: impl Fn(&Point3<f64>) -> Vector3<f64>, x: &Point3<f64>) -> Matrix3<f64> {
    const STEP: f64 = 1e-5;
    let column = |k| {
        let step = Vector3::ith(k, STEP);
        (field(&(x + step)) - field(&(x - step))) / (2.0 * STEP)
    };
    Matrix3::from_columns(&[column(0), column(1), column(2)])
}

/// An equilibrium without body forces: u = (3 − 4ν) β e_z − z ∇β (Papkovich and Neuber), β
/// harmonic.
fn papkovich_neuber(x: &Point3<f64>, poisson: f64) -> Vector3<f64> {
    let (growth, [sy, sz], [cy, cz]) =
        ((2f64.sqrt() * x.x).exp(), [x.y.sin(), x.z.sin()], [x.y.cos(), x.z.cos()]);
    let beta = growth * sy * sz;
    let gradient = Vector3::new(2f64.sqrt() * beta, growth * cy * sz, growth * sy * cz);
    Vector3::z() * ((3.0 - 4.0 * poisson) * beta) - gradient * x.z
}

#[test]
fn errors_fall_at_the_rates_of_theory() {
    let moduli = Moduli { young: 1e5, poisson: 0.3 };
    let exact = |x: &Point3<f64>| papkovich_neuber(x, moduli.poisson);
    let on_boundary = |x: &Point3<f64>| x.iter().any(|x| !(1e-9..1.0 - 1e-9).contains(x));
    for (element, cells, order) in
        [(Element::P1, 6, 1.0), (Element::P1Bar, 6, 1.0), (Element::P2, 3, 2.0)]
    {
        let error = |cells: u32| {
            let mesh = grid([cells; 3], |p| p / f64::from(cells));
            let problem = Problem::new(mesh, moduli, element, on_boundary);
            let loads = vec![Vector3::zeros(); problem.nodes.places.len()];
            problem.error(&problem.solve(exact, &loads, &Matrix3::zeros()), exact)
        };
        let (coarse, fine) = (error(cells), error(2 * cells));
        let [values, gradients] = [0, 1].map(|i| (coarse[i] / fine[i]).log2());
        assert!((gradients - order).abs() < 0.1, "{element}: gradients at order {gradients}");
        assert!((values - order - 1.0).abs() < 0.1, "{element}: values at order {values}");
    }
}

/// Rise of the tip of Cook's membrane in plane strain, by finite elements of `cells` a side.
fn cook(element: Element, cells: u32, poisson: f64) -> f64 {
    let mesh = grid([cells, cells, 1], |p| {
        let (s, t) = (p.x / f64::from(cells), p.y / f64::from(cells));
        Point3::new(48.0 * s, 44.0 * s + t * (44.0 - 28.0 * s), p.z)
    });
    let problem = Problem::new(mesh, Moduli { young: 1.0, poisson }, element, |x| x.x < 1e-9);
    let mut loads = vec![Vector3::zeros(); problem.nodes.places.len()];
    for owners in faces(&problem.mesh).into_values() {
        let (tet, face) = owners[0];
        let ends = FACES[face].map(|corner| problem.mesh.tets[tet as usize][corner]);
        let [a, b, c] = ends.map(|n| problem.mesh.vertices[n as usize]);
        if [a, b, c].iter().any(|p| p.x < 48.0 - 1e-9) {
            continue;
        }
        // A load of 1 over an edge of 16, thickness 1; on a quadratic face it lies on the middles.
        let share = Vector3::y() * (0.5 * (b - a).cross(&(c - a)).norm() / 16.0 / 3.0);
        let bearers = if element == Element::P2 {
            [[0, 1], [1, 2], [2, 0]].map(|[i, j]| problem.nodes.middle(ends[i], ends[j]))
        } else {
            ends
        };
        for n in bearers {
            loads[n as usize] += share;
        }
    }
    // Braced against motion along z, a million times as stiff as the body.
    let brace = Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, 1e6));
    let u = problem.solve(|_| Vector3::zeros(), &loads, &brace);
    let tip = problem.nodes.places.iter().position(|x| x.x > 47.9 && x.y > 59.9 && x.z < 1e-9);
    u[tip.expect("the corner at (48, 60) is a node")].y
}

#[test]
fn cooks_membrane_bends_as_far_as_converged_meshes_do() {
    // Young's modulus and load are 1; 2.3003 and 1.9382 are for a modulus of 10.
    for (poisson, tip) in [(0.3, 23.003), (0.499, 19.382)] {
        for (element, cells) in [(Element::P1Bar, 48), (Element::P2, 24)] {
            let found = cook(element, cells, poisson);
            assert!(
                (found / tip - 1.0).abs() < 0.02,
                "{element} ν {poisson}: {found} m, not {tip} m"
            );
        }
    }
    let locked = cook(Element::P1, 24, 0.499);
    assert!(locked < 0.5 * 19.382, "p1 should lock, found {locked} m");
}

#[test]
fn the_support_bears_what_the_contact_brings() {
    let mesh = grid([6, 6, 3], |p| Point3::new(p.x - 3.0, p.y - 3.0, p.z - 3.0) * 1e-3);
    let base: Vec<u32> = (0..mesh.vertices.len() as u32).filter(|n| n % 4 == 0).collect();
    for (law, element) in [(Law::NeoHookean, Element::P1Bar), (Law::StableNeoHookean, Element::P2)]
    {
        let moduli = Moduli { young: 2e5, poisson: 0.48 };
        let body = SoftBody::new(mesh.clone(), law, moduli, &base).unwrap();
        let fem =
            Fem::new(body, FemOptions { element, friction: 0.5, ..FemOptions::default() }).unwrap();
        let at = |x: f64, z: f64| vec![Isometry3::translation(x, 0.4e-3, z)];
        let path = vec![at(0.3e-3, 3.4e-3), at(0.5e-3, 3.4e-3)];
        let press = Press::along(vec![Shape::Sphere { radius: 4e-3 }], path).unwrap();
        let frame = fem.solve_path(&press).pop().unwrap().unwrap();
        let u = &frame.history.displacement;
        let mut forces = vec![Vector3::zeros(); u.len()];
        fem.system.solid.evaluate(u, &mut Strain::default(), &mut forces).unwrap();
        let (mut support, mut moment) = (Vector3::zeros(), Vector3::zeros());
        let held = fem.system.nodes.places.iter().zip(&forces).zip(&fem.system.nodes.fixed);
        for ((x, force), _) in held.filter(|(_, fixed)| **fixed) {
            support += force;
            moment += x.coords.cross(force);
        }
        let size = frame.wrench.force.norm();
        let (force, torque) = (support + frame.wrench.force, moment + frame.wrench.torque);
        // The residual force has a norm of 1e-7 N over some hundred nodes, on arms of 4 mm.
        assert!(
            size > 0.05 && force.norm() < 1e-6,
            "{element}: {} N left of {size} N",
            force.norm()
        );
        assert!(torque.norm() < 1e-8, "{element}: {} N m left", torque.norm());
    }
}

#[test]
fn the_corner_of_the_factor_is_the_stiffness_that_its_nodes_feel() {
    let mesh = grid([3; 3], |p| p * 1e-3);
    let held = |x: &Point3<f64>| x.z < 1e-9;
    let problem = Problem::new(mesh, Moduli { young: 1e5, poisson: 0.4 }, Element::P1Bar, held);
    let (places, fixed) = (&problem.nodes.places, &problem.nodes.fixed);
    let top: Vec<u32> = (0..64).filter(|&n| places[n as usize].z > 2.999e-3).collect();
    let pattern = Pattern::ending_in(&top, places, fixed, &problem.solid.couplings());
    let (mut strain, still) = (Strain::default(), vec![Vector3::zeros(); places.len()]);
    problem.solid.evaluate(&still, &mut strain, &mut still.clone()).unwrap();
    let mut matrix = pattern.matrix();
    problem.solid.assemble(&strain, &problem.solid.assembly_map(&pattern), &mut matrix, false);
    assert!(matrix.factorise(&pattern));
    let corner = matrix.corner(&pattern);
    let (size, first) = (corner.nrows(), pattern.size() - corner.nrows());
    assert_eq!(size, 48);
    // A force on one of the nodes, the rest of the body free to follow.
    for loaded in [0, 7, 40] {
        let mut x = vec![0.0; pattern.size()];
        x[first + loaded] = 1.0;
        matrix.solve(&pattern, &mut x);
        let moved = faer::Col::from_fn(size, |i| x[first + i]);
        let force = &corner * (corner.transpose() * &moved);
        for i in 0..size {
            let exact = f64::from(u8::from(i == loaded));
            // Rounding times a condition number of about 1e3.
            assert!((force[i] - exact).abs() < 1e-11, "{} N against {exact} N", force[i]);
        }
    }
}
