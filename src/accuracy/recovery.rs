//! Where the mesh is too coarse: the difference between the deformation gradient and a smoother one
//! recovered from it (Zienkiewicz & Zhu 1987, "A simple error estimator and adaptive procedure for
//! practical engineering analysis"). It ranks tets without another solution.

use crate::Result;
use crate::mesh::{QUADRATURE_POINTS, TetMesh, quadrature_point, signed_volume, unit_map};
use crate::parallel;
use crate::scene::Motion;
use glam::{DMat3, DVec3};

/// Tets whose stiffness differs by less than about this factor are averaged: strains jump where
/// tissues of different stiffness meet.
const SIMILAR_STIFFNESS: f64 = 2.0;

/// Returns for each element of the body of `motion`, at `positions`, the energy (J) of the difference
/// between its deformation gradient and the recovered one. Elements of rigid regions have none.
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) for a body of order 2 whose tets are not those of ten-node
/// tets.
pub(crate) fn recovery_errors(motion: &Motion, positions: &[DVec3]) -> Result<Vec<f64>> {
    let simulator = motion.simulator.as_ref();
    let mesh = simulator.mesh();
    let Some(model) = simulator.model().and_then(|m| m.elements()) else {
        return Ok(vec![0.0; mesh.element_count()]);
    };
    let elements = Elements::new(mesh, positions)?;
    let numbers = model.of_tets(mesh);
    let unit = motion.length_unit();
    let pieces = mesh.tets.len() / elements.count().max(1);
    let stiffness = |e: usize| numbers[pieces * e].map(|n| model.tets[n].small_strain(model.law));
    let recovered = elements.recovered_gradients(&stiffness);
    let error = |e: usize| {
        let Some([mu, lambda]) = stiffness(e) else {
            return 0.0;
        };
        let sum = |point: usize| {
            let l = quadrature_point(point);
            let (gradient, volume) = elements.gradient_at(e, l);
            let smooth: DMat3 = (0..4).map(|a| recovered[4 * e + a] * l[a]).sum();
            // The change of strain, which does not depend on rotations.
            let change = gradient.transpose() * (gradient - smooth);
            let strain = 0.5 * (change + change.transpose());
            let square: f64 = strain.to_cols_array().iter().map(|x| x * x).sum();
            let trace = strain.x_axis.x + strain.y_axis.y + strain.z_axis.z;
            volume.abs() * (mu * square + 0.5 * lambda * trace * trace)
        };
        let points = (0..QUADRATURE_POINTS).map(sum).sum::<f64>();
        unit.powi(3) * points / QUADRATURE_POINTS as f64
    };
    Ok(parallel::map(elements.count(), error))
}

/// The elements of a deformed body.
struct Elements<'a> {
    mesh: &'a TetMesh,
    positions: &'a [DVec3],
    /// Ten-node tets; empty for four-node tets.
    quadratic: Vec<[u32; 10]>,
}

impl<'a> Elements<'a> {
    fn new(mesh: &'a TetMesh, positions: &'a [DVec3]) -> Result<Elements<'a>> {
        Ok(Elements {
            mesh,
            positions,
            quadratic: match mesh.order.number() {
                1 => Vec::new(),
                _ => mesh.ten_node_tets()?,
            },
        })
    }

    fn count(&self) -> usize {
        match self.quadratic.len() {
            0 => self.mesh.tets.len(),
            count => count,
        }
    }

    fn corners(&self, e: usize) -> [u32; 4] {
        match self.quadratic.get(e) {
            Some([a, b, c, d, ..]) => [*a, *b, *c, *d],
            None => self.mesh.tets[e],
        }
    }

    /// Returns the deformation gradient of an element at the barycentric coordinates `l`, and the
    /// volume that the element would have if its Jacobian were everywhere that of this point.
    fn gradient_at(&self, e: usize, l: [f64; 4]) -> (DMat3, f64) {
        let (rest, now) = (&self.mesh.nodes, self.positions);
        match self.quadratic.get(e) {
            Some(nodes) => {
                let map = |x: &[DVec3]| unit_map(&nodes.map(|v| x[v as usize]), l).0;
                let from = map(rest);
                (map(now) * from.inverse(), from.determinant() / 6.0)
            }
            None => {
                let tet = self.mesh.tets[e];
                let map = |x: &[DVec3]| {
                    let [a, b, c, d] = tet.map(|v| x[v as usize]);
                    DMat3::from_cols(b - a, c - a, d - a)
                };
                let volume = signed_volume(tet.map(|v| rest[v as usize]));
                (map(now) * map(rest).inverse(), volume)
            }
        }
    }

    /// Returns the recovered gradient at each corner of each element: the mean by volume of those of
    /// the elements of similar stiffness around this node.
    fn recovered_gradients(&self, stiffness: &dyn Fn(usize) -> Option<[f64; 2]>) -> Vec<DMat3> {
        let class = |e: usize| {
            let mu = stiffness(e).map_or(0.0, |[mu, _]| mu);
            (mu.max(f64::MIN_POSITIVE).ln() / SIMILAR_STIFFNESS.ln()).round() as i32
        };
        let mut corners: Vec<(u32, i32, u32)> = Vec::with_capacity(4 * self.count());
        for e in 0..self.count() {
            let own = class(e);
            let numbered = (0u32..).zip(self.corners(e));
            corners.extend(numbered.map(|(a, v)| (v, own, 4 * e as u32 + a)));
        }
        corners.sort_unstable();
        let at_corner = |k: usize| {
            let l = std::array::from_fn(|a| f64::from(u8::from(a == k % 4)));
            self.gradient_at(k / 4, l)
        };
        let mut recovered = vec![DMat3::ZERO; 4 * self.count()];
        for same in corners.chunk_by(|a, b| a.0 == b.0 && a.1 == b.1) {
            let (mut sum, mut weight) = (DMat3::ZERO, 0.0);
            for (.., k) in same {
                let (gradient, volume) = at_corner(*k as usize);
                sum += gradient * volume.abs();
                weight += volume.abs();
            }
            for (.., k) in same {
                recovered[*k as usize] = sum * (1.0 / weight);
            }
        }
        recovered
    }
}
