//! Statistics and problems of a mesh: the content of `palpate info`.

use super::{
    AnatomicalFrame, BoundaryReport, DIHEDRAL_BINS, ElementOrder, Field, Location, PIECES,
    QualityReport, TetMesh, Topology, components,
};
use crate::number_format::significant;
use rayon::slice::ParallelSliceMut;
use std::collections::BTreeMap;
use std::fmt;

/// Report of `palpate info` on a mesh; its JSON keys are the names of these members. Lengths and
/// volumes are in the units of the file.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MeshDescription {
    /// Nodes that tets use.
    pub nodes: usize,
    /// Tets after the repairs: of order 2 the ten-node tets, whose corners the counts and qualities
    /// below describe.
    pub tets: usize,
    /// Order of the elements: 2 for ten-node tets.
    pub order: u32,
    /// Ten-node tets whose Jacobian is ≤ 0 at a quadrature point: they cannot be simulated with
    /// order 2.
    pub folded_ten_node_tets: usize,
    /// Faces that belong to one tet only.
    pub boundary_faces: usize,
    /// Sum of the volumes of the tets.
    pub volume: f64,
    /// Lower and upper corner of the bounding box of the nodes.
    pub bounds: [[f64; 3]; 2],
    /// Connected components of tets (through faces).
    pub components: usize,
    /// Nodes − edges + faces of the boundary: 2 for each sphere, 0 for each torus.
    pub euler_number: i64,
    /// Whether every boundary edge belongs to an even number of boundary faces.
    pub closed: bool,
    /// Whether every boundary edge belongs to exactly two boundary faces.
    pub edge_manifold: bool,
    /// Whether the boundary is edge-manifold and the boundary faces at every node form a single
    /// fan.
    pub vertex_manifold: bool,
    /// Boundary edges that do not belong to exactly two boundary faces.
    pub nonmanifold_edges: usize,
    /// Boundary nodes whose boundary faces do not form a single fan.
    pub nonmanifold_nodes: usize,
    /// Nodes at exactly the position of an earlier node.
    pub coincident_nodes: usize,
    /// Tets whose orientation was flipped.
    pub inverted_fixed: usize,
    /// Tets dropped for a repeated corner or zero volume.
    pub degenerate: usize,
    /// Tets dropped because they repeat the four nodes of an earlier one.
    #[serde(rename = "repeated")]
    pub duplicate_tets: usize,
    /// Nodes dropped because no tet uses them.
    pub unused_nodes: usize,
    /// Faces shared by more than two tets, treated as boundary of each.
    #[serde(rename = "crowded_faces")]
    pub overshared_faces: usize,
    /// Dihedral angles and the worst tets.
    pub quality: QualityReport,
    /// Every field.
    pub fields: Vec<FieldDescription>,
    /// The cell field of the regions, if there is one.
    pub region_field: Option<String>,
    /// The regions: the values of that field.
    pub regions: Vec<RegionDescription>,
    /// Length of one unit of the mesh in metres, if known.
    pub length_unit: Option<f64>,
    /// Frame of reference of the coordinates, if the file states one (read as RAS).
    pub frame: Option<AnatomicalFrame>,
    /// Repairs and irregularities, in words.
    pub warnings: Vec<String>,
}

/// Report of `palpate info` on a field.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FieldDescription {
    /// Its name in the file.
    pub name: String,
    /// Nodes or cells.
    pub location: Location,
    /// Number of components of a tuple.
    pub components: usize,
    /// Smallest finite value (of the norms of the tuples if there are several components); `None`
    /// if there is no finite value.
    pub min: Option<f64>,
    /// Largest finite value, with the same rule.
    pub max: Option<f64>,
}

impl FieldDescription {
    pub(super) fn new(field: &Field) -> FieldDescription {
        let range = field.range();
        FieldDescription {
            name: field.name.clone(),
            location: field.location,
            components: field.components,
            min: range.map(|r| r.0),
            max: range.map(|r| r.1),
        }
    }
}

/// Report of `palpate info` on a region.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RegionDescription {
    /// Its value in the field of the regions.
    pub label: i64,
    /// Its name, if known.
    pub name: Option<String>,
    /// Number of its tets.
    pub tets: usize,
    /// Their volume.
    pub volume: f64,
}

/// Returns the field of the regions, or a constant `label`, and the regions.
fn regions(mesh: &TetMesh) -> (Option<String>, Vec<RegionDescription>) {
    let field = mesh.region_field();
    let Some(field) = field.or_else(|| mesh.field("label", Location::Cell)) else {
        return (None, Vec::new());
    };
    let regions = mesh.regions_of(field).into_iter();
    let regions: Vec<RegionDescription> = regions
        .map(|(label, (tets, volume))| RegionDescription {
            label,
            name: mesh.region_names.get(&label).cloned(),
            tets,
            volume,
        })
        .collect();
    ((!regions.is_empty()).then(|| field.name.clone()), regions)
}

impl MeshDescription {
    /// Describes `mesh`. Time O(n log n), in parallel.
    pub fn new(mesh: &TetMesh) -> MeshDescription {
        let Some(elements) = mesh.quadratic_elements() else {
            return MeshDescription::of_linear(mesh);
        };
        let corners = MeshDescription::of_linear(&mesh.mesh_of_corners(&elements));
        let (low, high) = mesh.bounds();
        let folded = mesh.folded_elements(&elements);
        let labels = corners.region_field.as_deref();
        let labels = labels.and_then(|name| mesh.field(name, Location::Cell));
        let volumes = mesh.element_volumes(&elements);
        let mut of_label: BTreeMap<i64, f64> = BTreeMap::new();
        for (k, volume) in volumes.iter().enumerate() {
            let label = labels.and_then(|field| field.values.get(PIECES * k));
            *of_label.entry(label.map_or(0, |l| *l as i64)).or_default() += volume;
        }
        let curved = |region: &RegionDescription| RegionDescription {
            volume: of_label.get(&region.label).copied().unwrap_or(0.0),
            ..region.clone()
        };
        let mut description = MeshDescription {
            order: ElementOrder::Quadratic.number(),
            folded_ten_node_tets: folded.len(),
            volume: volumes.iter().sum(),
            regions: corners.regions.iter().map(curved).collect(),
            bounds: [low.to_array(), high.to_array()],
            ..corners
        };
        if let Some(first) = folded.first() {
            description.warnings.push(format!(
                "{} ten-node tets are inverted or folded (a Jacobian ≤ 0 at a quadrature point), the first of them tet {first} (counted from 0); order 2 cannot simulate them",
                folded.len()
            ));
        }
        description
    }

    /// Describes a mesh of four-node tets.
    fn of_linear(mesh: &TetMesh) -> MeshDescription {
        let topology = Topology::new(mesh);
        let shape = BoundaryReport::new(mesh, &topology);
        let (low, high) = mesh.bounds();
        let repairs = &mesh.repairs;
        let (region_field, regions) = regions(mesh);
        let mut description = MeshDescription {
            nodes: mesh.nodes.len(),
            tets: mesh.tets.len(),
            order: ElementOrder::Linear.number(),
            folded_ten_node_tets: 0,
            boundary_faces: shape.faces,
            volume: mesh.volume(),
            bounds: [low.to_array(), high.to_array()],
            components: components(&topology).1,
            euler_number: shape.euler_number(),
            closed: shape.closed,
            edge_manifold: shape.is_edge_manifold(),
            vertex_manifold: shape.is_vertex_manifold(),
            nonmanifold_edges: shape.non_manifold_edges.len(),
            nonmanifold_nodes: shape.non_manifold_nodes.len(),
            coincident_nodes: coincident_nodes(mesh),
            inverted_fixed: repairs.inverted_fixed,
            degenerate: repairs.degenerate,
            duplicate_tets: repairs.repeated,
            unused_nodes: repairs.unused_nodes,
            overshared_faces: repairs.overshared_faces,
            quality: QualityReport::new(mesh),
            fields: mesh.fields.iter().map(FieldDescription::new).collect(),
            region_field,
            regions,
            length_unit: mesh.length_unit,
            frame: mesh.frame,
            warnings: repairs.warnings.clone(),
        };
        description.warn(mesh);
        description
    }

    fn warn(&mut self, mesh: &TetMesh) {
        let mut warn = |count: usize, what: &str| {
            if count > 0 {
                self.warnings.push(format!("{count} {what}"));
            }
        };
        warn(
            self.nonmanifold_edges,
            "boundary edges do not belong to exactly two boundary faces",
        );
        warn(
            self.nonmanifold_nodes,
            "boundary nodes connect parts of the boundary that touch at this node only",
        );
        warn(
            self.coincident_nodes,
            "nodes coincide with another node; the mesh is disconnected there",
        );
        if self.components > 1 {
            warn(
                self.components,
                "connected components; each needs a support in a simulation",
            );
        }
        for field in &mesh.fields {
            let odd = field.values.iter().filter(|x| !x.is_finite()).count();
            let what = format!("values of field \"{}\" are not finite numbers", field.name);
            warn(odd, &what);
        }
    }
}

/// Counts the nodes at exactly the position of an earlier node.
fn coincident_nodes(mesh: &TetMesh) -> usize {
    // Adding zero turns −0 into 0.
    let mut keys: Vec<[u64; 3]> = mesh
        .nodes
        .iter()
        .map(|p| (*p + 0.0).to_array().map(f64::to_bits))
        .collect();
    keys.par_sort_unstable();
    keys.windows(2).filter(|w| w[0] == w[1]).count()
}

impl fmt::Display for MeshDescription {
    /// Long because it prints one line per property.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.bounds;
        let yes = |flag: bool, what: &'static str, no: &'static str| if flag { what } else { no };
        row(f, "nodes", grouped(self.nodes))?;
        row(f, "tets", grouped(self.tets))?;
        if self.order == ElementOrder::Quadratic.number() {
            let folded = match self.folded_ten_node_tets {
                0 => String::new(),
                count => format!("; {} with a Jacobian ≤ 0", grouped(count)),
            };
            row(f, "order", format!("2: tets with ten nodes{folded}"))?;
        }
        row(f, "boundary faces", grouped(self.boundary_faces))?;
        row(
            f,
            "boundary",
            format!(
                "{}, {}, Euler number {}",
                yes(self.closed, "closed", "open"),
                match (self.edge_manifold, self.vertex_manifold) {
                    (true, true) => "manifold",
                    (true, false) => "edge-manifold, non-manifold nodes",
                    _ => "non-manifold",
                },
                self.euler_number
            ),
        )?;
        row(f, "components", self.components.to_string())?;
        row(f, "volume", significant(self.volume))?;
        for (axis, name) in ["x", "y", "z"].iter().enumerate() {
            row(
                f,
                name,
                format!(
                    "{} … {}  (size {})",
                    significant(low[axis]),
                    significant(high[axis]),
                    significant(high[axis] - low[axis])
                ),
            )?;
        }
        self.quality.fmt(f)?;
        if let Some(unit) = self.length_unit {
            writeln!(f, "unit             {unit} m")?;
        }
        if let Some(frame) = self.frame {
            writeln!(f, "frame            {frame}")?;
        }
        if let Some(field) = &self.region_field {
            writeln!(f, "regions          from field \"{field}\"")?;
        }
        for region in &self.regions {
            writeln!(
                f,
                "  {:<5} {:>9} tets, volume {:<12.6} {}",
                region.label,
                region.tets,
                region.volume,
                region.name.as_deref().unwrap_or("")
            )?;
        }
        if !self.fields.is_empty() {
            writeln!(f, "fields")?;
        }
        let width = self.fields.iter().map(|f| f.name.chars().count()).max();
        for field in &self.fields {
            let kind = match field.components {
                1 => "scalar".into(),
                n => format!("{n} components"),
            };
            let range = match (field.min, field.max) {
                (Some(min), Some(max)) => format!("{} … {}", significant(min), significant(max)),
                _ => "no finite value".into(),
            };
            let length = yes(field.components > 1, " (length)", "");
            writeln!(
                f,
                "  {:width$}  {:5}  {kind:12}  {range}{length}",
                field.name,
                field.location.to_string(),
                width = width.unwrap_or(0)
            )?;
        }
        if !self.warnings.is_empty() {
            writeln!(f, "warnings")?;
        }
        self.warnings.iter().try_for_each(|w| writeln!(f, "  {w}"))
    }
}

impl fmt::Display for QualityReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        row(
            f,
            "quality",
            format!(
                "mean {:.3}, minimum {} (1 = regular, 0 = flat); {} below 0.01",
                self.mean,
                significant(self.min),
                grouped(self.slivers)
            ),
        )?;
        row(
            f,
            "dihedral angles",
            format!("{:.2}° … {:.2}°", self.min_dihedral, self.max_dihedral),
        )?;
        let most = self.dihedral_histogram.iter().copied().max().unwrap_or(0);
        for (bin, count) in self.dihedral_histogram.iter().enumerate() {
            let step = 180 / DIHEDRAL_BINS;
            let bar = match count {
                0 => String::new(),
                _ => format!(" {}", "█".repeat((40 * count).div_ceil(most))),
            };
            let low = bin * step;
            writeln!(
                f,
                "  {low:>3}–{:>3}° {:>11}{bar}",
                low + step,
                grouped(*count)
            )?;
        }
        writeln!(f, "worst tets")?;
        for w in self.worst.iter().take(3) {
            let [x, y, z] = w.centroid.map(significant);
            writeln!(
                f,
                "  {}: quality {}, smallest angle {:.2}°, at ({x}, {y}, {z})",
                w.tet,
                significant(w.quality),
                w.min_dihedral
            )?;
        }
        Ok(())
    }
}

fn row(f: &mut fmt::Formatter<'_>, name: &str, value: String) -> fmt::Result {
    writeln!(f, "{name:16} {value}")
}

/// Formats a count with a comma between thousands.
fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, d) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(d);
    }
    out
}
