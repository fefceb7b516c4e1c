//! Memory of a body, its solver and its raycaster: computed from array sizes, counted at
//! allocation, and allocated by the driver.

use super::{Axis, Cell, Chart, Run, Series, SeriesStyle};
use crate::Result;
use crate::generate;
use crate::gpu::{Gpu, array_size};
use crate::mesh::{Location, TetMesh, Topology};
use crate::physics::{GpuBody, Material, SolverKind};
use crate::render::Geometry;

/// The entity that an array has one item per.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Each {
    Node,
    Tet,
    Face,
    /// A face of a tet; inner ones count twice.
    Link,
    /// An entry in the rows of springs, where each spring appears twice; rows are padded to
    /// multiples of four.
    Spring,
}

/// Arrays of one part: bytes per item, whether they reserve space for cuts, and how many.
struct Arrays {
    part: &'static str,
    each: Each,
    item: u64,
    roomy: bool,
    arrays: u64,
}

const fn arrays(part: &'static str, each: Each, item: u64, roomy: bool, arrays: u64) -> Arrays {
    Arrays {
        part,
        each,
        item,
        roomy,
        arrays,
    }
}

/// The parts whose memory on the device is measured.
pub(crate) const DEVICE_PARTS: [&str; 4] = ["body", "symplectic", "implicit", "geometry"];

const ARRAYS: [Arrays; 14] = [
    // Positions, velocities, external forces, rows; masses.
    arrays("body", Each::Node, 16, true, 4),
    arrays("body", Each::Node, 8, true, 1),
    // Columns, of four neighbours per texel; stiffness and rest length.
    arrays("body", Each::Spring, 4, true, 1),
    arrays("body", Each::Spring, 8, true, 1),
    // Next positions, next velocities, forces.
    arrays("symplectic", Each::Node, 16, true, 3),
    arrays("implicit", Each::Node, 16, true, 3),
    // Two texels of preconditioner; product; and pairs of four vectors.
    arrays("implicit", Each::Node, 32, true, 1),
    arrays("implicit", Each::Node, 16, true, 9),
    arrays("implicit", Each::Spring, 16, true, 1),
    // Scalars, projections; vertices; links; faces.
    arrays("geometry", Each::Node, 4, true, 1),
    arrays("geometry", Each::Node, 16, true, 1),
    arrays("geometry", Each::Tet, 16, false, 1),
    arrays("geometry", Each::Link, 8, false, 1),
    arrays("geometry", Each::Face, 16, true, 1),
];

impl Arrays {
    /// Returns the bytes for `count` items, in rows of texels.
    fn bytes(&self, count: usize) -> u64 {
        let count = count as u64;
        let items = if self.roomy {
            count + count / 8 + 1024
        } else {
            count
        };
        // Texels have at most 16 bytes: a larger item takes several.
        let texels = items * self.item.div_ceil(16);
        let [width, rows] = array_size(u32::try_from(texels).unwrap_or(u32::MAX)).map(u64::from);
        self.arrays * width * rows * self.item.min(16)
    }

    /// Returns the marginal bytes per item of a large mesh.
    fn slope(&self) -> f64 {
        (self.arrays * self.item) as f64 * if self.roomy { 1.125 } else { 1.0 }
    }
}

/// Returns the computed GPU memory, in bytes, of `part` for `mesh`: `body`, `symplectic`,
/// `implicit` (solvers) or `geometry`. Rows of springs are counted without padding, so the body and
/// the implicit solver take some per cent more.
pub fn computed_bytes(part: &str, mesh: &TetMesh, topology: &Topology) -> f64 {
    let of = |a: &Arrays| {
        a.bytes(match a.each {
            Each::Node => mesh.nodes.len(),
            Each::Tet => mesh.tets.len(),
            Each::Face => topology.boundary.len(),
            Each::Link => 4 * mesh.tets.len(),
            Each::Spring => 2 * mesh.edges().len(),
        })
    };
    let bytes: u64 = ARRAYS.iter().filter(|a| a.part == part).map(of).sum();
    bytes as f64
}

/// Returns the bytes of the arrays that `make` allocates, and the bytes allocated by the driver.
pub(in crate::study) fn taken<T>(
    gpu: &Gpu,
    make: impl FnOnce() -> Result<T>,
) -> Result<(T, f64, f64)> {
    let given = || {
        let report = gpu.device().generate_allocator_report();
        report.map_or(f64::NAN, |r| r.total_allocated_bytes as f64)
    };
    let settle = || {
        // Uploads wait for a submit and hold memory until they are done.
        gpu.start_recording().submit()?;
        gpu.wait()
    };
    settle()?;
    let (made_before, given_before) = (gpu.bytes_allocated(), given());
    let made = make()?;
    settle()?;
    let bytes = (gpu.bytes_allocated() - made_before) as f64;
    Ok((made, bytes, given() - given_before))
}

const SETTINGS: [&str; 2] = ["part", "tets"];
const RESULTS: [&str; 6] = [
    "nodes",
    "springs",
    "faces",
    "computed_bytes",
    "made_bytes",
    "driver_bytes",
];

/// Measures memory against tets; returns the findings and the chart's name.
pub(super) fn measure(run: &Run) -> Result<(String, String)> {
    let tets: &[usize] = match run.quick {
        true => &[3_000, 10_000],
        false => &[10_000, 30_000, 100_000, 300_000],
    };
    let points: Vec<Vec<Cell>> = tets
        .iter()
        .flat_map(|n| DEVICE_PARTS.map(|part| vec![Cell::from(part), Cell::from(*n)]))
        .collect();
    let rows = run.measure("scaling-memory", &SETTINGS, &RESULTS, &points, |point| {
        let cells = (point[1].number() / 6.0).cbrt().round() as usize;
        let mesh = generate::benchmark_cube(cells, false)?;
        let topology = Topology::new(&mesh);
        let (made, given) = part_bytes(run.gpu, point[0].text(), &mesh)?;
        Ok(vec![
            mesh.nodes.len().into(),
            mesh.edges().len().into(),
            topology.boundary.len().into(),
            computed_bytes(point[0].text(), &mesh, &topology).into(),
            made.into(),
            given.into(),
        ])
    })?;
    let series = DEVICE_PARTS.iter().flat_map(|part| {
        let of = |column: &str| {
            let own = rows.iter().filter(|r| r.text("part") == *part);
            own.map(|r| [r.number("tets"), r.number(column) / r.number("tets")])
                .collect()
        };
        [
            Series::new(
                format!("{part}, measured"),
                SeriesStyle::LineMarks,
                of("made_bytes"),
            ),
            Series::new(
                format!("{part}, computed"),
                SeriesStyle::Dashed,
                of("computed_bytes"),
            ),
        ]
    });
    let chart = Chart {
        title: "Memory on the GPU".into(),
        x: Axis::log("tets"),
        y: Axis::log("memory a tet (bytes)"),
        series: series.collect(),
    };
    chart.save(run.dir, "scaling-memory")?;
    let mut text = String::from(
        "| part | bytes per node | per tet | per boundary face | per spring | largest mesh, bytes per tet: computed | measured | by the driver |\n|---|---|---|---|---|---|---|---|",
    );
    for part in DEVICE_PARTS {
        let last = rows.iter().rev().find(|r| r.text("part") == part);
        let Some(last) = last else { continue };
        let a_tet = |column: &str| last.number(column) / last.number("tets");
        let own = |each| {
            let own = ARRAYS.iter().filter(|a| a.part == part && a.each == each);
            own.map(Arrays::slope).sum::<f64>()
        };
        text += &format!(
            "\n| {part} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1} |",
            // An empty sum is -0.
            own(Each::Node) + 0.0,
            own(Each::Tet) + 4.0 * own(Each::Link) + 0.0,
            own(Each::Face) + 0.0,
            2.0 * own(Each::Spring) + 0.0,
            a_tet("computed_bytes"),
            a_tet("made_bytes"),
            a_tet("driver_bytes")
        );
    }
    text += "\n\nMemory is linear in nodes, tets and springs; for small meshes, the space reserved for cuts dominates.";
    Ok((text, "scaling-memory".into()))
}

/// Returns the bytes of arrays and of driver allocations for one part.
pub(crate) fn part_bytes(gpu: &Gpu, part: &str, mesh: &TetMesh) -> Result<(f64, f64)> {
    let body = || GpuBody::new(gpu, mesh, &Material::soft_tissue());
    match part {
        "body" => taken(gpu, body).map(|(_, made, given)| (made, given)),
        "geometry" => {
            let scalars = mesh
                .field("scalar", Location::Node)
                .map(|f| f.values.clone());
            let body = body()?;
            let topology = Topology::new(mesh);
            let (frame, array) = (body.nodes().frame(), body.nodes().array());
            let scalars = scalars.unwrap_or_default();
            let make = || Geometry::new(gpu, mesh, &topology, frame, array, &scalars);
            taken(gpu, make).map(|(_, made, given)| (made, given))
        }
        name => {
            let kind: SolverKind = name.parse()?;
            let body = body()?;
            taken(gpu, || kind.solver(gpu, &body)).map(|(_, made, given)| (made, given))
        }
    }
}
