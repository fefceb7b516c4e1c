//! Meshing of regions, those of scans and surfaces among them, with tetrahedra.
//!
//! A [`Domain`] assigns points to regions; [`mesh_domain`] meshes it. After Labelle & Shewchuk,
//! *Isosurface stuffing: fast tetrahedral meshes with good dihedral angles* (2007), extended to
//! several regions in the manner of Bronson, Levine & Whitaker, *Lattice cleaving* (2014):
//!
//! 1. `octree`: the smallest leaves along all boundaries, larger ones away from them; or leaves of
//!    wanted sizes (`size_field`).
//! 2. `lattice`: the octree’s points and tets, a body-centred cubic lattice where leaves are equal.
//! 3. `cut`: assigns points to regions, cuts the edges between regions, and snaps points close to
//!    a cut onto it.
//! 4. `stencil`, `junction`: subdivision of each tet.
//!    `volumes`: if the true volumes are known, boundaries are offset slightly to preserve them.
//! 5. `islands`, `pinches`: repair of small components and non-manifold boundaries.
//! 6. `optimise`: improvement of the worst tets.

mod closed_surface;
mod cut;
mod domain;
mod fans;
mod junction;
mod label_domain;
mod lattice;
mod mesh_report;
mod non_manifold;
mod octree;
mod optimise;
mod size_field;
mod small_components;
mod spacing;
mod stars;
mod stencil;
mod surface_distance;
mod threshold_domain;
mod threshold_range;
mod volume_correction;

pub(crate) use closed_surface::solid_angle;
pub use closed_surface::{ClosedSurface, SurfaceDomain};
pub use domain::{Domain, RegionVolume};
pub use label_domain::LabelDomain;
#[cfg(feature = "study")]
pub(crate) use mesh_report::peak_memory;
pub use mesh_report::{MeshReport, RegionReport};
pub(crate) use non_manifold::NonManifoldReport;
pub(crate) use optimise::OptimiserReport;
pub(crate) use size_field::EDGE_LENGTH;
pub use size_field::SizeField;
pub(crate) use small_components::IslandReport;
pub(crate) use spacing::{MAX_OUTSIDE_RATIO, find_spacing};
pub use threshold_domain::ThresholdDomain;
pub use threshold_range::ThresholdRange;

use crate::parallel;
use crate::progress::ProgressScope;
use crate::{Error, ProgressFn, Result};
use cut::{CutLattice, SampledLattice};
use domain::{OffsetDomain, Sampler};
use glam::DVec3;
use junction::Junctions;
use lattice::LatticeMesh;
use octree::{LeafSizes, Octree};
use std::sync::Arc;
use stencil::{Piece, Stencils};

/// Maximum number of corrections to match the true volumes; each leaves a fraction of the error.
const VOLUME_CORRECTIONS: usize = 3;

/// Target size of the tets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spacing {
    /// Edge of the lattice at region boundaries; tets have edges of about that length.
    Edge(f64),
    /// Target number of tets, for which the edge is searched.
    Tets(usize),
}

/// Options of [`mesh_domain`].
#[derive(Clone, Debug)]
pub struct MeshOptions {
    /// Size of the tets at region boundaries.
    pub spacing: Spacing,
    /// Maximum ratio of the size of interior tets to those at boundaries: 1, 2, 4, … (other values
    /// are rounded down).
    pub grading: f64,
    /// Sizes by place, in place of `grading`: the edge length of `spacing` is that of the smallest
    /// tets, others are in proportion to it.
    pub sizes: Option<Arc<SizeField>>,
    /// Components of a region below this volume are merged into their surroundings.
    pub min_island: f64,
    /// Offset of the lattice, in edges, from the lower corner of the domain's bounds, where it has
    /// a point by default.
    pub offset: DVec3,
}

impl Default for MeshOptions {
    fn default() -> MeshOptions {
        MeshOptions {
            spacing: Spacing::Tets(50_000),
            grading: 4.0,
            sizes: None,
            min_island: 0.0,
            offset: DVec3::ZERO,
        }
    }
}

/// A meshed domain.
#[derive(Clone, Debug)]
pub struct MeshedDomain {
    /// Node positions.
    pub nodes: Vec<DVec3>,
    /// Four nodes per tet, positively oriented.
    pub tets: Vec<[u32; 4]>,
    /// The region of each tet, from 1 on.
    pub regions: Vec<u16>,
    /// Statistics of the meshing and the quality.
    pub report: MeshReport,
}

impl MeshedDomain {
    /// Drops tets outside and unused nodes, and measures the rest.
    ///
    /// # Errors
    /// [`Error::Input`] if nothing is left.
    pub(crate) fn from_pieces(
        nodes: Vec<DVec3>,
        pieces: Vec<Piece>,
        report: MeshReport,
    ) -> Result<MeshedDomain> {
        let mut number = vec![u32::MAX; nodes.len()];
        let mut filling = MeshedDomain {
            nodes: Vec::new(),
            tets: Vec::new(),
            regions: Vec::new(),
            report,
        };
        for (tet, region) in pieces.into_iter().filter(|p| p.1 != 0) {
            filling.tets.push(tet.map(|v| {
                let n = &mut number[v as usize];
                if *n == u32::MAX {
                    *n = filling.nodes.len() as u32;
                    filling.nodes.push(nodes[v as usize]);
                }
                *n
            }));
            filling.regions.push(region);
        }
        if filling.tets.is_empty() {
            let edge = filling.report.edge;
            let resolving = filling.report.resolving_edge.filter(|e| *e < edge);
            return Err(Error::Input(format!(
                "nothing of the body is left at an edge length of {edge}: all its parts are \
                thinner; decrease the edge length{} or increase the number of tets",
                resolving.map_or(String::new(), |e| format!(" to {}", two_digits(e)))
            )));
        }
        filling
            .report
            .measure(&filling.nodes, &filling.tets, &filling.regions);
        Ok(filling)
    }
}

/// Meshes the regions of `domain` with tets that conform at the interfaces.
///
/// The result for the same domain and options is bitwise identical on any number of threads.
/// `progress` receives the stages.
///
/// # Errors
/// An [`Error::Cancelled`]; an error for a domain without an inside, invalid options, an edge so
/// small that the tets cannot be counted with 32 bits, or so large that nothing of the body is
/// left.
pub fn mesh_domain(
    domain: &dyn Domain,
    options: &MeshOptions,
    progress: ProgressFn,
) -> Result<MeshedDomain> {
    check(options)?;
    let trial = |edge| build_lattice(domain, options, edge, progress);
    let domain_mesh = match options.spacing {
        Spacing::Edge(edge) => trial(edge)?,
        Spacing::Tets(wanted) => {
            let (low, high) = domain.bounds();
            let known: f64 = domain.volumes().iter().map(|r| r.volume).sum();
            let volume = match known > 0.0 {
                true => known,
                // Bodies fill about a third of their bounding boxes.
                false => (high - low).to_array().iter().product::<f64>() / 3.0,
            };
            let graded = options.sizes.is_some() || options.grading >= 2.0;
            find_spacing(wanted, volume, graded, trial, DividedDomain::counts)?
        }
    };
    let DividedDomain {
        lattice,
        mut nodes,
        mut pieces,
        mut report,
    } = domain_mesh;
    report.resolving_edge = domain.resolving_edge();
    let truth = domain.volumes();
    let mut added = Vec::new();
    for _ in 0..VOLUME_CORRECTIONS {
        if !volume_correction::correct_region_volumes(&truth, &nodes, &pieces, &mut added) {
            break;
        }
        let added = &added[..];
        (nodes, pieces) = divide(
            OffsetDomain { domain, added },
            &lattice,
            progress,
            &mut report,
        )?;
    }
    drop(lattice);
    report.stage("volumes");
    let part = ProgressScope::begin(progress, "cleaning", 0.7)?;
    report.islands =
        small_components::merge_small_components(&nodes, &mut pieces, options.min_island, &part)?;
    let own = nodes.len();
    report.pinches = non_manifold::repair_non_manifold(&mut nodes, &mut pieces, &part)?;
    report.stage("cleaning");
    let part = ProgressScope::begin(progress, "shapes", 0.8)?;
    let weighed = OffsetDomain {
        domain,
        added: &added,
    };
    report.optimiser =
        optimise::optimise(weighed, report.edge, own, (&mut nodes, &mut pieces), &part)?;
    report.stage("shapes");
    ProgressScope::begin(progress, "quality", 0.9)?;
    let mut filling = MeshedDomain::from_pieces(nodes, pieces, report)?;
    filling.measure_surface_distance(domain);
    ProgressScope::begin(progress, "done", 1.0)?;
    Ok(filling)
}

/// A domain divided into tets, including those outside along its boundary.
struct DividedDomain {
    lattice: LatticeMesh,
    nodes: Vec<DVec3>,
    pieces: Vec<Piece>,
    report: MeshReport,
}

impl DividedDomain {
    /// Returns the number of tets inside, and of all. A lattice that misses the body has no tets
    /// along its boundary; a fraction of the lattice stands for them.
    fn counts(&self) -> [usize; 2] {
        let inside = self.pieces.iter().filter(|p| p.1 != 0).count();
        let all = match self.pieces.len() {
            0 => self.lattice.tets.len() / MAX_OUTSIDE_RATIO,
            pieces => pieces,
        };
        [inside, all]
    }
}

/// Builds a lattice with that edge over the domain, cuts it and subdivides its tets.
fn build_lattice(
    domain: &dyn Domain,
    options: &MeshOptions,
    edge: f64,
    progress: ProgressFn,
) -> Result<DividedDomain> {
    let mut report = MeshReport::start(edge);
    let leaf_sizes = match options.sizes.as_deref() {
        None => LeafSizes::Graded(options.grading.log2().floor() as u32),
        Some(sizes) => LeafSizes::Field(sizes),
    };
    let part = ProgressScope::begin(progress, "octree", 0.0)?;
    let tree = Octree::new(domain, edge, leaf_sizes, options.offset, &part)?;
    report.stage("octree");
    let part = ProgressScope::begin(progress, "lattice", 0.1)?;
    let lattice = LatticeMesh::new(&tree, &part)?;
    report.stage("lattice");
    let plain = OffsetDomain { domain, added: &[] };
    let (nodes, pieces) = divide(plain, &lattice, progress, &mut report)?;
    report.stage("tets");
    Ok(DividedDomain {
        lattice,
        nodes,
        pieces,
        report,
    })
}

/// Cuts a lattice at the interfaces between regions, and subdivides its tets.
fn divide(
    domain: OffsetDomain,
    lattice: &LatticeMesh,
    progress: ProgressFn,
    report: &mut MeshReport,
) -> Result<(Vec<DVec3>, Vec<Piece>)> {
    let part = ProgressScope::begin(progress, "boundaries", 0.2)?;
    let sampled = SampledLattice::new(domain, lattice, &part)?;
    let cut = CutLattice::new(domain, lattice, sampled, &part)?;
    let junctions = Junctions::new(domain, lattice, &cut, &part)?;
    let part = ProgressScope::begin(progress, "tets", 0.5)?;
    report.snapped_nodes = cut.snapped;
    [report.triple_points, report.quadruple_points] = junctions.counts();
    let nodes: Vec<DVec3> = [&cut.positions[..], &cut.cuts, &junctions.points].concat();
    let stencils = Stencils {
        lattice,
        cut: &cut,
        junctions: &junctions,
        nodes: &nodes,
    };
    let pieces = parallel::collect(lattice.tets.len(), |range, pieces| {
        if !part.should_continue() {
            return;
        }
        let mut sampler = Sampler::new(domain);
        for t in range {
            stencils.subdivide(t as u32, &mut sampler, pieces);
        }
    });
    part.check_cancelled()?;
    Ok((nodes, pieces))
}

fn check(options: &MeshOptions) -> Result<()> {
    let invalid = |what: &str, value: f64, want: &str| {
        Err(Error::Input(format!("{what} must be {want}, got {value}")))
    };
    if let Spacing::Edge(edge) = options.spacing
        && !(edge.is_finite() && edge > 0.0)
    {
        return invalid("edge length", edge, "finite and positive");
    }
    if !(1.0..=1024.0).contains(&options.grading) {
        return invalid("grading", options.grading, "1 to 1024");
    }
    if options.min_island.is_nan() || options.min_island < 0.0 {
        return invalid("minimum island volume", options.min_island, "≥ 0");
    }
    if !options.offset.is_finite() || options.offset.abs().max_element() > 1.0 {
        return Err(Error::Input(format!(
            "lattice offset must be −1 to 1 edge lengths along each axis, got {}",
            options.offset
        )));
    }
    Ok(())
}

/// Rounds a positive length down to two significant digits, for advice.
pub fn two_digits(length: f64) -> f64 {
    let unit = 10f64.powf(length.log10().floor() - 1.0);
    // Within rounding of the next digit.
    let digits = (length / unit + 1e-9).floor();
    // Division by a power of ten prints fewer digits than multiplication by its inverse.
    match unit < 1.0 {
        true => digits / (1.0 / unit).round(),
        false => digits * unit,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::ops::ControlFlow;
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// A ball inside a ball.
    struct Balls;

    impl Domain for Balls {
        fn bounds(&self) -> (DVec3, DVec3) {
            (DVec3::NEG_ONE, DVec3::ONE)
        }

        fn weights(&self, p: DVec3, weights: &mut Vec<(u16, f64)>) {
            weights.clear();
            weights.push((1, 1.0 - p.length()));
            weights.push((2, 1.2 * (0.6 - p.length())));
        }
    }

    #[test]
    fn meshing_cancels_at_every_progress_point() {
        let options = MeshOptions {
            spacing: Spacing::Tets(3000),
            min_island: 1e-9,
            ..MeshOptions::default()
        };
        let (calls, parts) = (AtomicUsize::new(0), Mutex::new(BTreeSet::new()));
        let whole = mesh_domain(&Balls, &options, &|what, _| {
            calls.fetch_add(1, Ordering::Relaxed);
            parts.lock().unwrap().insert(what.to_owned());
            ControlFlow::Continue(())
        });
        assert!(whole.unwrap().tets.len() > 1000);
        let (all, parts) = (calls.into_inner(), parts.into_inner().unwrap());
        assert!(parts.len() >= 7 && all > 50, "{all} {parts:?}");
        for last in (0..all).step_by(all / 40 + 1) {
            let calls = AtomicUsize::new(0);
            let ended = mesh_domain(&Balls, &options, &|_, _| {
                // The callback has cancelled once and must not be called again.
                match calls.fetch_add(1, Ordering::Relaxed) == last {
                    true => ControlFlow::Break(()),
                    false => ControlFlow::Continue(()),
                }
            });
            assert!(
                matches!(ended, Err(Error::Cancelled)),
                "call {last} of {all}"
            );
            let more = calls.into_inner() - last;
            // Calls of other threads may have been in flight.
            assert!(
                more <= 1 + rayon::current_num_threads(),
                "{more} calls after cancellation"
            );
        }
    }
}
