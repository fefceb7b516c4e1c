//! Rendering of a body in pieces, each drawn separately, on machines or devices that cannot hold
//! the whole.

use super::mesh_manifest::MeshManifest;
use super::picture::{DEFAULT_SIZE, DisplayMode};
use super::{PictureEntry, Scene};
use crate::gpu::Gpu;
use crate::io;
use crate::mesh::{MeshPartition, MeshPiece, TetMesh, Topology};
use crate::render::{Background, Geometry, Image, Mode, RaySegments, Raycaster, local_positions};
use crate::{Error, Result};
use std::path::Path;

/// Writes `mesh` as `count` pieces, partitioned along a k-d tree: the index at `path` (.pvtu) and
/// one .vtu file per piece in its folder, with ghost cells and the global data.
///
/// # Errors
/// [`Error::Input`] for another file extension or an invalid number of pieces, [`Error::Mesh`] for
/// inconsistent fields, or an error of writing.
pub fn write_pieces(path: impl AsRef<Path>, mesh: &TetMesh, count: usize) -> Result<()> {
    let path = path.as_ref();
    if !io::is_pieces(path) {
        return Err(Error::Input(format!(
            "{}: the index of pieces must have the extension .pvtu",
            path.display()
        )));
    }
    let part_of = MeshPartition::kd_parts(mesh, count)?;
    let (whole, extra) = MeshManifest::new(mesh, count)?;
    let manifest = whole.to_bytes()?;
    let held;
    let mesh = match extra {
        None => mesh,
        Some(field) => {
            let mut with = mesh.clone();
            with.set_field(field)?;
            held = with;
            &held
        }
    };
    let parted = MeshPartition::new(mesh, &part_of)?;
    io::write_pieces(path, count, &manifest, |k| parted.extract(k))
}

/// A piece of a mesh, with the global data.
pub struct Piece {
    piece: MeshPiece,
    whole: MeshManifest,
}

impl Piece {
    /// Reads piece `number`, counted from 0, of the index at `path` (.pvtu); the other pieces are
    /// not read.
    ///
    /// # Errors
    /// As the readers of [`io`](crate::io).
    pub fn read(path: impl AsRef<Path>, number: usize) -> Result<Piece> {
        let (piece, manifest) = io::read_piece(path, number)?;
        let whole = MeshManifest::from_bytes(&manifest)?;
        Ok(Piece { piece, whole })
    }

    /// Returns its tetrahedra, followed by the ghost cells of its neighbours.
    pub fn mesh(&self) -> &MeshPiece {
        &self.piece
    }

    /// Computes the ray segments within this piece for the picture that `scene` describes. The mesh
    /// entries of the scene are ignored.
    ///
    /// # Errors
    /// [`Error::Input`] for a scene with more than the volume of a static body or an invalid scene;
    /// as [`Raycaster::intervals`].
    pub fn intervals(&self, gpu: &Gpu, scene: &Scene) -> Result<RaySegments> {
        scene.check_in_pieces()?;
        let MeshPiece {
            mesh,
            owned_tets: own,
            ..
        } = &self.piece;
        let (seen, measures) = self.whole.scalar_field(scene, mesh)?;
        let frame = self.whole.frame();
        let topology = Topology::new(mesh);
        let positions = local_positions(gpu, &frame, &mesh.nodes)?;
        let shown = topology.restricted_to(*own);
        let mut geometry = Geometry::new(gpu, mesh, &shown, frame, &positions, seen.scalars())?;
        geometry.set_scalars(mesh, seen.scalars(), measures.range)?;
        geometry.set_table_statistics(&measures);
        let transfer = scene.transfer(&seen)?;
        let options = scene.raycast_options()?;
        if options.light.is_on() {
            geometry.enable_lighting(mesh, &topology, seen.scalars())?;
        }
        drop((topology, shown));
        let mut raycaster = Raycaster::with_options(gpu, geometry, &transfer, options)?;
        if scene.picture.has_region_appearance() {
            let regions = self.whole.regions(mesh);
            let looks = scene.region_appearances(mesh, regions, frame.scale, &transfer)?;
            raycaster.set_regions(Some(&looks))?;
        }
        let size = scene.picture.size.unwrap_or(DEFAULT_SIZE);
        let camera = self.whole.camera(scene, size)?;
        raycaster.intervals(&camera, scene.drawn_size()?)
    }
}

impl PictureEntry {
    /// Whether regions are hidden, or have their own appearance.
    pub(super) fn has_region_appearance(&self) -> bool {
        !(self.region.is_empty() && self.hide.is_empty())
    }
}

impl Scene {
    /// Composites the picture of this scene from the ray segments of all pieces of its body.
    ///
    /// # Errors
    /// [`Error::Input`] for segments of another size, or an invalid scene.
    pub fn composite(&self, segments: &RaySegments) -> Result<Image> {
        let size = self.drawn_size()?;
        if segments.size() != size {
            let ([a, b], [c, d]) = (segments.size(), size);
            return Err(Error::Input(format!(
                "the pieces were rendered at {a} x {b} pixels, but the picture has {c} x {d}; sizes must match"
            )));
        }
        Ok(match self.samples_each_way()? {
            1 => segments.image(),
            n => segments.image().box_downsampled(n),
        })
    }

    /// As [`Scene::composite`], in the form of a PNG: RGBA per pixel, and its width and height.
    ///
    /// # Errors
    /// As [`Scene::composite`].
    pub fn composite_rgba(&self, segments: &RaySegments) -> Result<(Vec<u8>, [u32; 2])> {
        let background: Background = self.background()?;
        let image = self.composite(segments)?;
        Ok((image.rgba8(background), image.size))
    }

    /// Returns the rendered size, which is larger than the picture with supersampling.
    fn drawn_size(&self) -> Result<[u32; 2]> {
        let samples = self.samples_each_way()?;
        let size = self.picture.size.unwrap_or(DEFAULT_SIZE);
        Ok(size.map(|n| n.saturating_mul(samples)))
    }

    /// Rejects settings that pictures of pieces do not support.
    fn check_in_pieces(&self) -> Result<()> {
        let picture = &self.picture;
        let annotated = [picture.legend, picture.scale_bar, picture.time].contains(&Some(true))
            || picture.axes.is_some()
            || picture.title.is_some();
        let found = [
            (
                self.display_mode()? != DisplayMode::Inside(Mode::Composite),
                "modes other than composite",
            ),
            (self.solver.name.is_some(), "a solver, since it is static"),
            (
                !self.body.is_empty() || self.grid.is_some() || self.cage.is_some(),
                "several bodies, grids and cages",
            ),
            (
                self.mesh.rest.is_some()
                    || !(self.mesh.join.is_empty() && self.mesh.split.is_empty()),
                "a rest mesh, joined meshes and split interfaces",
            ),
            (!self.scan.is_empty(), "scans"),
            (!self.skin.is_empty(), "skins"),
            (
                picture.boundaries.as_deref() == Some("smooth"),
                "smooth boundaries of regions, which are found on the whole mesh",
            ),
            (
                self.light.model.as_deref() == Some("path"),
                "light paths, which cross from piece to piece",
            ),
            (
                !(self.plane.is_empty() && self.isosurface.is_empty())
                    || picture.volume == Some(false),
                "planes and isosurfaces",
            ),
            (
                self.light.shadows.is_some_and(|s| s > 0.0),
                "shadows (pieces do not shadow each other)",
            ),
            (
                annotated,
                "a legend, a scale bar, axes, a title or the time",
            ),
        ];
        match found.iter().find(|(asked, _)| *asked) {
            None => Ok(()),
            Some((_, what)) => Err(Error::Input(format!(
                "a body in pieces does not support {what}; remove that, or render the whole mesh on a machine with enough memory (palpate render)"
            ))),
        }
    }
}
