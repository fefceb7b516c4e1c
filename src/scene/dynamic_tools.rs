//! Dynamic tools: rigid bodies with mass, free or held by a spring. They are rigid regions of the
//! body's mesh and interact with it by self-contact. Shapes other than spheres, capsules and boxes
//! are meshed.

use super::element_order::four_node_mesh;
use super::tool::apply_appearance;
use super::{ContactEntry, GrabEntry, LabelOrName, Scene, TissueEntry, TissueTable, ToolEntry};
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, Field, Location, ScalarType, TetMesh};
use crate::meshing::mesh_file;
use crate::physics::{Shape, Tool, ToolPose};
use crate::skin::{Mapping, Skin, SkinBase};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::BTreeMap;

/// Default density of a tool on a spring, kg/m³: that of water.
const DENSITY: f64 = 1000.0;

/// Number of subdivisions of the icosahedron that approximates a sphere.
const ICOSPHERE_SUBDIVISIONS: usize = 2;

/// Size of the core to which a spring is attached, over the inscribed sphere.
const CORE_RATIO: f64 = 0.5;

/// Approximate number of tetrahedra of a closed surface.
const TETS: usize = 3000;

/// Number of nodes nearest to the centre of mass to which the spring of a meshed tool is attached.
const SPRING_NODES: usize = 12;

/// Nodes and tetrahedra of a tool in its own frame, and the sphere of nodes to which its spring is
/// attached.
struct DynamicToolMesh {
    nodes: Vec<DVec3>,
    tets: Vec<[u32; 4]>,
    middle: DVec3,
    reach: f64,
}

impl DynamicToolMesh {
    fn of(entry: &ToolEntry, shape: &Shape, name: &str) -> Result<DynamicToolMesh> {
        let convex = match (shape, &entry.surface) {
            (Shape::Sdf(_), Some(file)) => {
                let mesh = mesh_file(file, TETS)?;
                return Ok(DynamicToolMesh::held(mesh.nodes, mesh.tets));
            }
            (Shape::Sphere { radius }, _) => Convex::round(*radius, 0.0),
            (Shape::Capsule { radius, length }, _) => Convex::round(*radius, *length),
            (Shape::Box { half }, _) => Convex::cuboid(*half),
            (Shape::Plane | Shape::Sdf(_), _) => {
                return Err(Error::Input(format!(
                    "the [[tool]] {name} has a mass or a spring: only spheres, capsules, boxes and closed surfaces may; remove both"
                )));
            }
        };
        let (nodes, tets) = convex.filled();
        Ok(DynamicToolMesh {
            nodes,
            tets,
            middle: DVec3::ZERO,
            reach: 1.01 * CORE_RATIO * convex.within,
        })
    }

    /// Creates a tool from tetrahedra, with the spring attached near their centre of mass.
    fn held(nodes: Vec<DVec3>, tets: Vec<[u32; 4]>) -> DynamicToolMesh {
        let (mut all, mut first) = (0.0, DVec3::ZERO);
        for tet in &tets {
            let corners = tet.map(|v| nodes[v as usize]);
            let volume = volume(&corners);
            all += volume;
            first += volume * corners.iter().sum::<DVec3>() / 4.0;
        }
        let middle = first / all;
        let mut far: Vec<f64> = nodes.iter().map(|p| p.distance(middle)).collect();
        far.sort_by(f64::total_cmp);
        let last = far.iter().take(SPRING_NODES).next_back();
        DynamicToolMesh {
            reach: 1.001 * last.copied().unwrap_or(0.0),
            nodes,
            tets,
            middle,
        }
    }

    fn volume(&self) -> f64 {
        let of = |tet: &[u32; 4]| volume(&tet.map(|v| self.nodes[v as usize]));
        self.tets.iter().map(of).sum()
    }
}

fn volume([a, b, c, d]: &[DVec3; 4]) -> f64 {
    (b - a).cross(c - a).dot(d - a) / 6.0
}

/// Surface of a convex shape around its centre, in its own frame.
struct Convex {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// Radius of the inscribed sphere around the centre.
    within: f64,
}

impl Convex {
    /// Creates a sphere, elongated by `length` along z.
    fn round(radius: f64, length: f64) -> Convex {
        let (mut vertices, mut triangles) = icosahedron();
        for _ in 0..ICOSPHERE_SUBDIVISIONS {
            triangles = quartered(&mut vertices, &triangles);
        }
        for p in &mut vertices {
            *p = radius * p.normalize();
            p.z += 0.5 * length * p.z.signum();
        }
        Convex {
            vertices,
            triangles,
            within: radius,
        }
    }

    fn cuboid(half: DVec3) -> Convex {
        let corner = |k: usize| half * DVec3::from([0, 1, 2].map(|a| [-1.0, 1.0][k >> a & 1]));
        let sides = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        Convex {
            vertices: (0..8).map(corner).collect(),
            triangles: sides
                .iter()
                .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
                .collect(),
            within: half.min_element(),
        }
    }

    /// Returns nodes and tetrahedra that fill the shape: a core around the centre, to which a
    /// spring is attached, and a layer around it.
    fn filled(&self) -> (Vec<DVec3>, Vec<[u32; 4]>) {
        let count = self.vertices.len() as u32;
        let reach = self.vertices.iter().map(|p| p.length()).fold(0.0, f64::max);
        let shrunk = CORE_RATIO * self.within / reach;
        let mut nodes = self.vertices.clone();
        nodes.extend(self.vertices.iter().map(|p| shrunk * *p));
        nodes.push(DVec3::ZERO);
        let mut tets = Vec::with_capacity(4 * self.triangles.len());
        for triangle in &self.triangles {
            // Neighbouring prisms split their common side alike if vertices are ordered by number.
            let mut own = *triangle;
            own.sort_unstable();
            let [a, b, c] = own;
            let [p, q, r] = own.map(|v| v + count);
            tets.extend([[a, b, c, r], [a, b, q, r], [a, p, q, r]]);
            tets.push([p, q, r, 2 * count]);
        }
        for tet in &mut tets {
            let [a, b, c, d] = tet.map(|v| nodes[v as usize]);
            if (b - a).cross(c - a).dot(d - a) < 0.0 {
                tet.swap(2, 3);
            }
        }
        (nodes, tets)
    }
}

impl ToolEntry {
    /// Whether its motion is dynamic rather than prescribed.
    pub(super) fn is_dynamic(&self) -> bool {
        self.mass.is_some() || self.spring_stiffness.is_some()
    }

    /// Returns its surface as a skin embedded in the body `carrier`, of which the tool is a region.
    pub(super) fn dynamic_tool_skin(&self, gpu: &Gpu, carrier: &SkinBase) -> Result<Skin> {
        let (at, turn) = self.initial_pose()?;
        let mut surface = self.surface(0.0)?;
        surface
            .vertices
            .iter_mut()
            .for_each(|p| *p = at + turn * *p);
        let mut skin = Skin::new(gpu, &surface, carrier, Mapping::default())?;
        apply_appearance(self, &mut skin)?;
        Ok(skin)
    }

    fn check_carried(&self, name: &str) -> Result<()> {
        let refuse = |why: &str| Err(Error::Input(format!("the [[tool]] {name} {why}")));
        let positive = |x: Option<f64>| x.is_none_or(|x| x > 0.0 && x.is_finite());
        if !(positive(self.mass) && positive(self.spring_stiffness) && positive(self.max_force)) {
            return refuse(
                "must have a positive, finite mass (kg), spring_stiffness (N/m) and max_force (N)",
            );
        }
        if self.max_force.is_some() && self.spring_stiffness.is_none() {
            return refuse("has `max_force` without `spring_stiffness`; set both");
        }
        if self.spring_stiffness.is_none() && self.path.is_some() {
            return refuse(
                "has `mass` and `path` without a coupling between them; set `spring_stiffness`, or remove `mass`",
            );
        }
        if self.rotation.is_some() || self.file.is_some() || self.gap.is_some() {
            return refuse(
                "has a mass or a spring: `rotation`, `file` and `gap` are then not supported; remove them (set the gap in [contact])",
            );
        }
        Ok(())
    }
}

impl Scene {
    /// Returns this scene and `mesh` with the tools that have a mass or a spring added as rigid
    /// regions of the mesh, with grabs as their springs, and with contact.
    ///
    /// # Errors
    /// [`Error::Input`] for invalid dynamic tools.
    pub fn with_dynamic_tools(&self, mut mesh: TetMesh) -> Result<(Scene, TetMesh)> {
        let mut scene = self.clone();
        for (number, entry) in scene.tool.iter_mut().enumerate() {
            let name = || format!("tool{}", number + 1);
            entry.name.get_or_insert_with(name);
        }
        let all = std::mem::take(&mut scene.tool);
        let (dynamic, kinematic): (Vec<_>, Vec<_>) =
            all.into_iter().partition(ToolEntry::is_dynamic);
        scene.tool = kinematic;
        if dynamic.is_empty() {
            return Ok((self.clone(), mesh));
        }
        if self.element_order(&mesh).0 == ElementOrder::Linear {
            mesh = four_node_mesh(mesh);
        }
        if !self.body.is_empty() || self.grid.is_some() || self.cage.is_some() {
            return Err(Error::Input(
                "a [[tool]] with a mass or a spring requires a single tetrahedral body, not [[body]], [grid] or [cage]; give it a path instead".into(),
            ));
        }
        if self.pin.is_empty()
            && self.moves.is_empty()
            && self.floor.is_none()
            && !self.supports_body()
        {
            return Err(Error::Input(
                "a [[tool]] with a mass or a spring requires supports of the body; add a [[pin]], or a [[tool]] that is a plane".into(),
            ));
        }
        let frictions = dynamic.iter().filter_map(|tool| tool.friction);
        let friction = frictions.fold(None, |most: Option<f64>, mu| {
            Some(most.map_or(mu, |m| m.max(mu)))
        });
        let contact = scene.contact.get_or_insert_with(ContactEntry::default);
        contact.friction = contact.friction.or(friction);
        let unit = self.mesh.unit.as_ref().map(|u| u.metres()).transpose()?;
        let unit = unit.or(mesh.length_unit).unwrap_or(1.0);
        for entry in &dynamic {
            scene.carry(entry, &mut mesh, unit)?;
        }
        scene.carried = dynamic;
        Ok((scene, mesh))
    }

    /// Adds a tool to `mesh`, and its material and spring to the scene.
    fn carry(&mut self, entry: &ToolEntry, mesh: &mut TetMesh, unit: f64) -> Result<()> {
        let name = entry.name.clone().unwrap_or_default();
        entry.check_carried(&name)?;
        let (at, turn) = entry.initial_pose()?;
        let tool = Tool {
            shape: entry.shape()?,
            pose: ToolPose::new(at, turn),
            friction: entry.friction.unwrap_or(0.0),
            gap: None,
        };
        tool.check()?;
        let mut solid = DynamicToolMesh::of(entry, &tool.shape, &name)?;
        for p in &mut solid.nodes {
            *p = at + turn * *p;
        }
        let middle = at + turn * solid.middle;
        let near = |p: &DVec3| p.distance(middle) <= solid.reach;
        if entry.spring_stiffness.is_some() && mesh.nodes.iter().any(near) {
            return Err(Error::Input(format!(
                "the spring of the [[tool]] {name} would also attach nodes of the body, because these lie too close to its centre of mass ({middle}); move the tool away, or give it a path and no spring"
            )));
        }
        let volume = solid.volume() * unit.powi(3);
        append(mesh, &name, &solid.nodes, &solid.tets)?;
        let table = TissueTable {
            regions: Some(vec![LabelOrName::Name(name.clone())]),
            density: Some(entry.mass.map_or(DENSITY, |mass| mass / volume)),
            rigid: true,
            ..TissueTable::default()
        };
        let tissues = &mut self.material.tissues;
        if tissues
            .insert(name.clone(), TissueEntry::Table(table))
            .is_some()
        {
            return Err(Error::Input(format!(
                "the [[tool]] {name} has the name of a tissue of [material]; rename it"
            )));
        }
        if let Some(stiffness) = entry.spring_stiffness {
            self.grab.push(GrabEntry {
                name: Some(format!("{name} spring")),
                at: middle.to_array(),
                radius: solid.reach,
                path: entry.path.clone().unwrap_or_else(|| vec![[0.0; 4]]),
                release_time: None,
                spring_stiffness: Some(stiffness),
                max_force: entry.max_force,
            });
        }
        self.picture.hide.push(name);
        Ok(())
    }
}

/// Adds tetrahedra to `mesh` as a region of that name. Fields are set to their first value there,
/// which keeps their ranges.
fn append(mesh: &mut TetMesh, name: &str, nodes: &[DVec3], tets: &[[u32; 4]]) -> Result<()> {
    let known = mesh.named_region_field().map(|f| f.name.clone());
    let field = known.clone().unwrap_or_else(|| "label".to_owned());
    if known.is_none() {
        let labels = Field {
            name: field.clone(),
            location: Location::Cell,
            components: 1,
            values: vec![1.0; mesh.tets.len()],
            scalar_type: ScalarType::I32,
        };
        mesh.set_field(labels)?;
        mesh.region_names.insert(1, "body".to_owned());
    }
    if mesh.region_names.values().any(|other| other == name) {
        return Err(Error::Input(format!(
            "the [[tool]] {name} has the name of a region of the mesh; rename it"
        )));
    }
    let first = mesh.nodes.len() as u32;
    let mut fields: Vec<Field> = mesh.fields.clone();
    mesh.nodes.extend(nodes);
    mesh.tets.extend(tets.iter().map(|t| t.map(|v| v + first)));
    mesh.order = ElementOrder::Linear;
    for own in &mut fields {
        let more = match own.location {
            Location::Node => nodes.len(),
            Location::Cell => tets.len(),
        };
        let mut value: Vec<f64> = own.values.iter().take(own.components).copied().collect();
        value.resize(own.components, 0.0);
        if own.name == field && own.location == Location::Cell {
            let most = own.values.iter().copied().fold(0.0, f64::max);
            value = vec![most + 1.0];
            mesh.region_names.insert(most as i64 + 1, name.to_owned());
        }
        let extra = std::iter::repeat_n(value, more).flatten();
        own.values.extend(extra);
        mesh.set_field(own.clone())?;
    }
    Ok(())
}

fn icosahedron() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let golden = 0.5 * (1.0 + 5.0f64.sqrt());
    let mut vertices = Vec::new();
    for axis in 0..3 {
        for (a, b) in [
            (-1.0, -golden),
            (1.0, -golden),
            (-1.0, golden),
            (1.0, golden),
        ] {
            let mut p = [0.0; 3];
            p[axis] = a;
            p[(axis + 1) % 3] = b;
            vertices.push(DVec3::from(p).normalize());
        }
    }
    // Its faces are the triples of mutually nearest vertices.
    let edge = 1.06;
    let near = |a: usize, b: usize| vertices[a].distance(vertices[b]) < edge;
    let mut triangles = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(c, a) {
                    let [p, q, r] = [a, b, c].map(|v: usize| vertices[v]);
                    let outwards = (q - p).cross(r - p).dot(p) > 0.0;
                    let [a, b, c] = [a, b, c].map(|v| v as u32);
                    triangles.push(if outwards { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    (vertices, triangles)
}

/// Returns each triangle subdivided into four, with new vertices at the edge midpoints.
fn quartered(vertices: &mut Vec<DVec3>, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut middles = BTreeMap::new();
    let mut middle = |a: u32, b: u32| {
        *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
            let between = 0.5 * (vertices[a as usize] + vertices[b as usize]);
            vertices.push(between.normalize());
            vertices.len() as u32 - 1
        })
    };
    let mut finer = Vec::with_capacity(4 * triangles.len());
    for [a, b, c] in triangles.iter().copied() {
        let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
        finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
    }
    finer
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn filled_shape_has_positive_tets_and_full_volume() {
        let pi = std::f64::consts::PI;
        for (convex, volume, tolerance) in [
            (Convex::round(2.0, 0.0), 32.0 / 3.0 * pi, 0.06),
            (Convex::round(1.0, 3.0), (4.0 / 3.0 + 3.0) * pi, 0.06),
            (Convex::cuboid(DVec3::new(1.0, 2.0, 3.0)), 48.0, 1e-12),
        ] {
            let (nodes, tets) = convex.filled();
            let mesh = TetMesh::new(nodes, tets, Vec::new(), Vec::new()).unwrap();
            let topology = crate::mesh::Topology::new(&mesh);
            assert_eq!(topology.boundary.len(), convex.triangles.len());
            let filled: f64 = (0..mesh.tets.len()).map(|t| mesh.tet_volume(t)).sum();
            assert!(
                (filled / volume - 1.0).abs() < tolerance,
                "{filled} {volume}"
            );
            assert!((0..mesh.tets.len()).all(|t| mesh.tet_volume(t) > 0.0));
        }
    }

    #[test]
    fn attached_nodes_centre_on_centre_of_mass() {
        let shift = DVec3::new(1.0, -2.0, 0.5);
        let (mut nodes, tets) = Convex::cuboid(DVec3::new(1.0, 2.0, 3.0)).filled();
        nodes.iter_mut().for_each(|p| *p += shift);
        let solid = DynamicToolMesh::held(nodes, tets);
        assert!(solid.middle.distance(shift) < 1e-12, "{}", solid.middle);
        assert!((solid.volume() - 48.0).abs() < 1e-9);
        let held = solid.nodes.iter();
        let held = held.filter(|p| p.distance(solid.middle) <= solid.reach);
        // The nodes of the core, the centre, and all equidistant corners.
        assert!(held.count() >= SPRING_NODES);
    }
}
