//! The finer space in which the error of a solution is estimated: that of quadratic tets on the same
//! mesh for linear ones, and of each tet divided into eight for quadratic ones. It contains the
//! solution exactly.

use super::bisection::MarkedEdges;
use super::quadratic::{PIECES, TenNodes};
use super::quadratic_shape::shape_functions;
use super::{ElementOrder, Field, Location, TET_EDGES, TetMesh};
use crate::Result;
use crate::parallel;
use glam::DVec3;
use std::collections::BTreeMap;

/// A mesh of order 2 whose space of shape functions contains that of a coarser mesh.
pub(crate) struct FinerSpace {
    /// The finer mesh. The nodes of the coarser mesh come first, in their order.
    pub mesh: TetMesh,
    /// Number of nodes of the coarser mesh.
    coarse_nodes: usize,
    /// First entry of each further node in `entries`, and their number.
    starts: Vec<usize>,
    /// Nodes of the coarser mesh, with the values of their shape functions at the further nodes.
    entries: Vec<(u32, f64)>,
}

/// The barycentric coordinates of the ten nodes of a tet: corners, then middles of edges.
fn node_coordinates() -> [[f64; 4]; 10] {
    let mut coordinates = [[0.0; 4]; 10];
    for (a, own) in coordinates.iter_mut().take(4).enumerate() {
        own[a] = 1.0;
    }
    for (own, edge) in coordinates[4..].iter_mut().zip(TET_EDGES) {
        edge.into_iter().for_each(|a| own[a] = 0.5);
    }
    coordinates
}

impl FinerSpace {
    /// Returns the finer space of bodies of `mesh`, of the order of the mesh.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the finer mesh would have too many nodes.
    pub fn new(mesh: &TetMesh) -> Result<FinerSpace> {
        match mesh.order {
            ElementOrder::Linear => Ok(FinerSpace::of_linear_tets(
                mesh,
                mesh.with_mid_edge_nodes()?,
            )),
            ElementOrder::Quadratic => FinerSpace::of_quadratic_tets(mesh),
        }
    }

    /// Returns the space of bodies of `mesh`, of its order, in which the `chosen` elements are divided
    /// into eight, and their neighbours as far as these must fit them.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the finer mesh would have too many nodes.
    pub fn locally(mesh: &TetMesh, chosen: &[bool]) -> Result<FinerSpace> {
        match mesh.order {
            ElementOrder::Linear => Ok(FinerSpace::of_divided_linear_tets(mesh, chosen)),
            ElementOrder::Quadratic => FinerSpace::of_divided_quadratic_tets(mesh, chosen),
        }
    }

    fn of_divided_linear_tets(mesh: &TetMesh, chosen: &[bool]) -> FinerSpace {
        let marks = MarkedEdges::new(&mesh.tets, mesh.edges(), &mesh.nodes, chosen);
        let marked: Vec<[u32; 2]> = marks.marked().collect();
        let middle = |edge: [u32; 2]| {
            let place = marked.binary_search(&edge).unwrap_or_default();
            (mesh.nodes.len() + place) as u32
        };
        let (tets, parents) = divide_all(mesh, &marks, &middle);
        let mut space = FinerSpace {
            mesh: TetMesh {
                tets,
                fields: divided_fields(mesh, &parents, &marked),
                ..mesh.clone()
            },
            coarse_nodes: mesh.nodes.len(),
            starts: (0..=marked.len()).map(|edge| 2 * edge).collect(),
            entries: marked.as_flattened().iter().map(|v| (*v, 0.5)).collect(),
        };
        space.mesh.nodes = space.interpolate(&mesh.nodes);
        space
    }

    fn of_divided_quadratic_tets(mesh: &TetMesh, chosen: &[bool]) -> Result<FinerSpace> {
        let elements = mesh.ten_node_tets()?;
        let corners = mesh.mesh_of_corners(&elements);
        let mut middles: Vec<([u32; 2], u32)> = elements.iter().flat_map(edge_nodes).collect();
        middles.sort_unstable();
        middles.dedup();
        let middle = |edge: [u32; 2]| {
            let found = middles.binary_search_by_key(&edge, |(edge, _)| *edge);
            found.ok().map(|k| middles[k].1)
        };
        let edges = middles.iter().map(|(edge, _)| *edge).collect();
        let marks = MarkedEdges::new(&corners.tets, edges, &corners.nodes, chosen);
        let (tets, parents) =
            divide_all(&corners, &marks, &|edge| middle(edge).unwrap_or_default());
        let divided = TetMesh {
            tets,
            fields: divided_fields(&corners, &parents, &[]),
            ..corners
        };
        // The element that each edge without a node lies in.
        let coordinates = node_coordinates();
        let mut values = BTreeMap::new();
        for (tet, parent) in divided.tets.iter().zip(&parents) {
            for [a, b] in TET_EDGES.map(|e| e.map(|k| tet[k])) {
                let edge = [a.min(b), a.max(b)];
                if middle(edge).is_none() {
                    let element = &elements[*parent as usize];
                    let own = || values_between(element, &coordinates, edge);
                    values.entry(edge).or_insert_with(own);
                }
            }
        }
        let (mut starts, mut entries) = (vec![0], Vec::new());
        for value in values.into_values() {
            entries.extend(value);
            starts.push(entries.len());
        }
        let mut space = FinerSpace {
            mesh: divided.with_middles(middle)?,
            coarse_nodes: mesh.nodes.len(),
            starts,
            entries,
        };
        space.mesh.nodes = space.interpolate(&mesh.nodes);
        Ok(space)
    }

    fn of_linear_tets(mesh: &TetMesh, finer: TetMesh) -> FinerSpace {
        let edges = mesh.edges();
        FinerSpace {
            mesh: finer,
            coarse_nodes: mesh.nodes.len(),
            starts: (0..=edges.len()).map(|edge| 2 * edge).collect(),
            entries: edges.as_flattened().iter().map(|v| (*v, 0.5)).collect(),
        }
    }

    fn of_quadratic_tets(mesh: &TetMesh) -> Result<FinerSpace> {
        let elements = mesh.ten_node_tets()?;
        let pieces = TetMesh {
            order: ElementOrder::Linear,
            ..mesh.clone()
        };
        let edges = pieces.edges();
        let mut values: Vec<Option<Vec<(u32, f64)>>> = vec![None; edges.len()];
        let coordinates = node_coordinates();
        for (nodes, group) in elements.iter().zip(mesh.tets.chunks(PIECES)) {
            for [a, b] in group
                .iter()
                .flat_map(|t| TET_EDGES.map(|e| e.map(|k| t[k])))
            {
                // Every edge of a piece is among them.
                let edge = edges.binary_search(&[a.min(b), a.max(b)]);
                let value = &mut values[edge.unwrap_or_default()];
                if value.is_none() {
                    *value = Some(values_between(nodes, &coordinates, [a, b]));
                }
            }
        }
        let (mut starts, mut entries) = (vec![0], Vec::new());
        for value in values {
            entries.extend(value.unwrap_or_default());
            starts.push(entries.len());
        }
        let mut space = FinerSpace {
            mesh: pieces.with_mid_edge_nodes()?,
            coarse_nodes: mesh.nodes.len(),
            starts,
            entries,
        };
        // Curved edges stay curved.
        space.mesh.nodes = space.interpolate(&mesh.nodes);
        Ok(space)
    }

    /// Returns the vectors at the nodes of the finer mesh, given those at the nodes of the coarser
    /// one: the same function.
    pub fn interpolate(&self, coarse: &[DVec3]) -> Vec<DVec3> {
        let further = self.starts.windows(2).map(|range| {
            let entries = &self.entries[range[0]..range[1]];
            entries.iter().map(|(v, w)| *w * coarse[*v as usize]).sum()
        });
        coarse.iter().copied().chain(further).collect()
    }

    /// Returns the edges of linear tets that the further nodes are in the middle of.
    pub fn edges_of_middles(&self) -> Vec<[u32; 2]> {
        let pairs = self.entries.chunks_exact(2);
        pairs.map(|ends| [ends[0].0, ends[1].0]).collect()
    }

    /// Returns the nodes of the finer mesh at which every function of the coarser space is 0 that is 0
    /// at the nodes `fixed` of the coarser mesh.
    pub fn fixed_nodes(&self, fixed: &[bool]) -> Vec<u32> {
        let old = (0..self.coarse_nodes).filter(|v| fixed[*v]);
        let further = self.starts.windows(2).enumerate().filter(|(_, range)| {
            let entries = &self.entries[range[0]..range[1]];
            !entries.is_empty() && entries.iter().all(|(v, _)| fixed[*v as usize])
        });
        let further = further.map(|(k, _)| self.coarse_nodes + k);
        old.chain(further).map(|v| v as u32).collect()
    }
}

/// Returns the edges of an element, as (smaller, larger) corner, with the nodes in their middle.
fn edge_nodes(element: &TenNodes) -> [([u32; 2], u32); 6] {
    std::array::from_fn(|k| {
        let [a, b] = TET_EDGES[k].map(|corner| element[corner]);
        ([a.min(b), a.max(b)], element[4 + k])
    })
}

/// Returns the tets of a divided mesh, and for each of them the one that it is a part of.
fn divide_all(
    mesh: &TetMesh,
    marks: &MarkedEdges,
    middle: &(impl Fn([u32; 2]) -> u32 + Sync),
) -> (Vec<[u32; 4]>, Vec<u32>) {
    let parts = parallel::map(mesh.tets.len(), |t| marks.divide(mesh.tets[t], middle));
    let numbered = (0u32..).zip(&parts);
    let parents = numbered.flat_map(|(t, own)| std::iter::repeat_n(t, own.len()));
    let parents = parents.collect();
    (parts.into_iter().flatten().collect(), parents)
}

/// Returns the fields of a divided mesh: those of tets are repeated; those of nodes are averaged along
/// the divided `edges`, except that a whole number (a label) that is not that of both ends is 0.
fn divided_fields(mesh: &TetMesh, parents: &[u32], edges: &[[u32; 2]]) -> Vec<Field> {
    let of = |field: &Field| {
        let width = field.components.max(1);
        let tuple = |k: u32| &field.values[k as usize * width..][..width];
        let values = match field.location {
            Location::Cell => parents.iter().flat_map(|t| tuple(*t)).copied().collect(),
            Location::Node => {
                let is_label = field.values.iter().all(|x| x.fract() == 0.0);
                let mut values = field.values.clone();
                for [a, b] in edges {
                    let pairs = tuple(*a).iter().zip(tuple(*b));
                    values.extend(pairs.map(|(x, y)| match is_label && x != y {
                        true => 0.0,
                        false => 0.5 * (x + y),
                    }));
                }
                values
            }
        };
        Field {
            values,
            name: field.name.clone(),
            ..*field
        }
    };
    mesh.fields.iter().map(of).collect()
}

/// Returns the values of the shape functions of a ten-node tet half-way between two of its nodes,
/// without zeros.
fn values_between(
    nodes: &TenNodes,
    coordinates: &[[f64; 4]; 10],
    ends: [u32; 2],
) -> Vec<(u32, f64)> {
    let mut l = [0.0; 4];
    for end in ends {
        let place = nodes.iter().position(|v| *v == end).unwrap_or_default();
        for (l, own) in l.iter_mut().zip(coordinates[place]) {
            *l += 0.5 * own;
        }
    }
    let values = nodes.iter().copied().zip(shape_functions(l));
    values.filter(|(_, value)| *value != 0.0).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::generate;

    /// A mesh of order 2 with curved edges.
    fn curved() -> TetMesh {
        let bar = generate::bar([2, 1, 1], DVec3::new(1.0, 0.6, 0.5)).unwrap();
        let mut mesh = bar.with_mid_edge_nodes().unwrap();
        let bend = |p: DVec3| DVec3::new(p.x, p.y + 0.1 * p.x * p.x, p.z - 0.05 * p.x * p.y);
        mesh.nodes.iter_mut().for_each(|p| *p = bend(*p));
        mesh
    }

    #[test]
    fn finer_space_of_linear_tets_contains_them() {
        let mesh = generate::bar([2, 1, 1], DVec3::new(1.0, 0.6, 0.5)).unwrap();
        let space = FinerSpace::new(&mesh).unwrap();
        assert_eq!(space.interpolate(&mesh.nodes), space.mesh.nodes);
        assert_eq!(space.mesh.order, ElementOrder::Quadratic);
    }

    #[test]
    fn finer_space_of_quadratic_tets_contains_quadratic_functions() {
        let mesh = curved();
        let space = FinerSpace::new(&mesh).unwrap();
        let coarse = mesh.ten_node_tets().unwrap();
        let finer = space.mesh.ten_node_tets().unwrap();
        assert_eq!(finer.len(), PIECES * coarse.len());
        // A function of the coarse space with arbitrary values at its nodes.
        let wave = |v: usize| DVec3::new((v as f64).sin(), (3.0 * v as f64).cos(), 0.1 * v as f64);
        let values: Vec<DVec3> = (0..mesh.nodes.len()).map(wave).collect();
        let fine_values = space.interpolate(&values);
        let centre = shape_functions([0.25; 4]);
        let at_centre = |nodes: &TenNodes, values: &[DVec3]| -> DVec3 {
            let parts = nodes.iter().zip(centre);
            parts.map(|(v, n)| n * values[*v as usize]).sum()
        };
        let corners = node_coordinates();
        for (k, piece) in finer.iter().enumerate() {
            // The barycentric coordinates of the piece's centre in its element.
            let element = &coarse[k / PIECES];
            let mut l = [0.0; 4];
            for v in &piece[..4] {
                let place = element.iter().position(|own| own == v).unwrap();
                (0..4).for_each(|a| l[a] += 0.25 * corners[place][a]);
            }
            let parts = element.iter().zip(shape_functions(l));
            let expected: DVec3 = parts.map(|(v, n)| n * values[*v as usize]).sum();
            assert!(at_centre(piece, &fine_values).distance(expected) < 1e-13);
        }
        // A value at a further node that is off is seen.
        let mut wrong = fine_values;
        wrong[mesh.nodes.len()].x += 0.1;
        let differs = |(k, piece): (usize, &TenNodes)| {
            let right = space.interpolate(&values);
            let off = at_centre(piece, &wrong).distance(at_centre(piece, &right));
            k < finer.len() && off > 1e-6
        };
        assert!(finer.iter().enumerate().any(differs));
    }

    /// Which elements of a mesh are divided in a test: every seventh.
    fn some(mesh: &TetMesh) -> Vec<bool> {
        (0..mesh.element_count()).map(|e| e % 7 == 3).collect()
    }

    #[test]
    fn divided_space_contains_functions_of_coarser_one() {
        let bar = generate::bar([3, 2, 2], DVec3::new(1.0, 0.6, 0.5)).unwrap();
        let mut curved = bar.with_mid_edge_nodes().unwrap();
        let bend = |p: DVec3| DVec3::new(p.x, p.y + 0.1 * p.x * p.x, p.z - 0.05 * p.x * p.y);
        curved.nodes.iter_mut().for_each(|p| *p = bend(*p));
        for mesh in [bar, curved] {
            let space = FinerSpace::locally(&mesh, &some(&mesh)).unwrap();
            assert_eq!(space.mesh.order, mesh.order);
            assert!(space.mesh.element_count() > mesh.element_count() + 7);
            // A polynomial of the degree of the elements, in barycentric coordinates: the curved rest
            // shape, and an affine function of it.
            let function = |x: &DVec3| DVec3::new(x.y - 2.0 * x.z, 3.0 * x.x, x.x + x.y);
            let coarse: Vec<DVec3> = mesh.nodes.iter().map(function).collect();
            let fine = space.interpolate(&coarse);
            for (value, x) in fine.iter().zip(&space.mesh.nodes) {
                assert!(value.distance(function(x)) < 1e-14);
            }
            let volume = |mesh: &TetMesh| match mesh.order {
                ElementOrder::Linear => mesh.volume(),
                ElementOrder::Quadratic => {
                    let elements = mesh.ten_node_tets().unwrap();
                    mesh.element_volumes(&elements).iter().sum()
                }
            };
            assert!((volume(&space.mesh) / volume(&mesh) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn divided_mesh_is_conforming_and_keeps_its_shape() {
        let first = generate::ball(0.1, 5).unwrap();
        let (area, worst) = (boundary_area(&first), worst_shape(&first));
        let mut mesh = first.clone();
        // The same corner again and again.
        for _ in 0..9 {
            let far = |t: &usize| (mesh.tet_nodes(*t)[0] - first.bounds().1).length();
            let near = (0..mesh.tets.len()).min_by(|a, b| far(a).total_cmp(&far(b)));
            let chosen: Vec<bool> = (0..mesh.tets.len()).map(|t| Some(t) == near).collect();
            let before = mesh.tets.len();
            mesh = FinerSpace::locally(&mesh, &chosen).unwrap().mesh;
            assert!(mesh.tets.len() > before && mesh.tets.len() < before + 400);
            // A hanging node would open both sides of a face.
            assert!((boundary_area(&mesh) / area - 1.0).abs() < 1e-12);
            assert!((mesh.volume() / first.volume() - 1.0).abs() < 1e-12);
            assert!((0..mesh.tets.len()).all(|t| mesh.tet_volume(t) > 0.0));
        }
        let now = worst_shape(&mesh);
        assert!(now > 0.2 * worst, "{now} {worst}");
    }

    fn boundary_area(mesh: &TetMesh) -> f64 {
        let topology = crate::mesh::Topology::new(mesh);
        let area = |face: &crate::mesh::BoundaryFace| {
            let nodes = topology.boundary_nodes(mesh, *face);
            let [a, b, c] = nodes.map(|v| mesh.nodes[v as usize]);
            0.5 * (b - a).cross(c - a).length()
        };
        topology.boundary.iter().map(area).sum()
    }

    /// The smallest volume of a tet over the cube of its longest edge.
    fn worst_shape(mesh: &TetMesh) -> f64 {
        let shape = |t: usize| {
            let x = mesh.tet_nodes(t);
            let longest = TET_EDGES.map(|[a, b]| x[a].distance(x[b]));
            mesh.tet_volume(t) / longest.into_iter().fold(0.0, f64::max).powi(3)
        };
        (0..mesh.tets.len())
            .map(shape)
            .fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn divided_mesh_has_fields_of_its_tets() {
        let mut mesh = generate::bar([2, 1, 1], DVec3::new(1.0, 0.6, 0.5)).unwrap();
        let labels = (0..mesh.tets.len()).map(|t| (t % 3) as f64).collect();
        mesh.set_field(Field::scalar("label", Location::Cell, labels))
            .unwrap();
        let heights = mesh.nodes.iter().map(|x| x.z + 0.5).collect();
        mesh.set_field(Field::scalar("height", Location::Node, heights))
            .unwrap();
        let ends = mesh
            .nodes
            .iter()
            .map(|x| if x.x > 0.99 { 2.0 } else { 1.0 });
        mesh.set_field(Field::scalar("end", Location::Node, ends.collect()))
            .unwrap();
        let fine = FinerSpace::locally(&mesh, &some(&mesh)).unwrap().mesh;
        let values = |mesh: &TetMesh, name: &str, at| mesh.field(name, at).unwrap().values.clone();
        let volume_of = |mesh: &TetMesh, label: f64| -> f64 {
            let own = values(mesh, "label", Location::Cell);
            let all = (0..mesh.tets.len()).filter(|t| own[*t] == label);
            all.map(|t| mesh.tet_volume(t)).sum()
        };
        for label in [0.0, 1.0, 2.0] {
            assert!((volume_of(&fine, label) - volume_of(&mesh, label)).abs() < 1e-14);
        }
        let heights = values(&fine, "height", Location::Node);
        for (height, x) in heights.iter().zip(&fine.nodes) {
            assert!((height - x.z - 0.5).abs() < 1e-14);
        }
        for (end, x) in values(&fine, "end", Location::Node).iter().zip(&fine.nodes) {
            let expected = match x.x {
                x if x > 0.99 => 2.0,
                x if x < 0.51 => 1.0,
                // Between the two.
                _ => 0.0,
            };
            assert_eq!(*end, expected, "{x}");
        }
    }

    #[test]
    fn nodes_between_fixed_nodes_are_fixed() {
        for mesh in [
            curved(),
            generate::bar([2, 1, 1], DVec3::new(1.0, 0.6, 0.5)).unwrap(),
        ] {
            let space = FinerSpace::new(&mesh).unwrap();
            let fixed: Vec<bool> = mesh.nodes.iter().map(|p| p.x < 0.3).collect();
            let found = space.fixed_nodes(&fixed);
            // A function with arbitrary values at the free nodes is 0 at exactly these.
            let free = |(v, is): (usize, &bool)| match is {
                true => DVec3::ZERO,
                false => DVec3::splat(1.5 + (v as f64).sin()),
            };
            let values: Vec<DVec3> = fixed.iter().enumerate().map(free).collect();
            let fine = space.interpolate(&values);
            let zeros = (0..fine.len()).filter(|v| fine[*v] == DVec3::ZERO);
            assert_eq!(found, zeros.map(|v| v as u32).collect::<Vec<_>>());
            assert!(!found.is_empty() && found.len() < fine.len() / 2);
        }
    }
}
