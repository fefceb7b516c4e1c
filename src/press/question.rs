//! What a press asks for, fixed on the shape: place, direction, radius and depth, whatever the mesh.

use super::setup::PressSetup;
use super::site::{self, Boundary, PressSite};
use super::{DEPTH, MAX_DEPTH, PressOptions};
use crate::gpu::Gpu;
use crate::mesh::{TetMesh, Topology};
use crate::render::Camera;
use crate::scene::{Scene, Stage};
use crate::{Error, Result};

/// Where and how far a fingertip presses; lengths in file units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Question {
    pub site: PressSite,
    pub radius: f64,
    pub depth: f64,
    /// Force at which loading stops, N.
    pub force: Option<f64>,
    /// The view of the body at rest.
    pub camera: Camera,
}

impl Question {
    /// Returns what `wanted` asks for on the body of `scene`, and its mesh.
    ///
    /// # Errors
    /// As [`Press::new`](super::Press::new).
    pub fn new(
        gpu: &Gpu,
        (scene, mesh): (&Scene, TetMesh),
        wanted: &PressOptions,
    ) -> Result<(Question, TetMesh)> {
        wanted.check()?;
        let setup = PressSetup::on_table(scene, &mesh, wanted.radius)?;
        let mut still = setup.scene.clone();
        still.solver.name = None;
        still.tool.clear();
        // Only its shape is looked at; strain and stress need a body that is simulated.
        still.picture.field = None;
        // The default site is at the centre of this view, which is the same for all pictures.
        still.camera.frame_all.get_or_insert(true);
        let mut still = Stage::with_mesh(gpu, &still, mesh)?;
        let mesh = still.mesh().clone();
        let boundary = Boundary::new(&mesh, &Topology::new(&mesh), &mesh.nodes);
        let camera = *still.camera_mut();
        if wanted.pick.is_none() {
            // The default site is part of the measurement: it must not follow the framing.
            still.frame_all()?;
        }
        let site = site::find_site(&mut still, &boundary, wanted, setup.radius)?;
        drop(still);
        if setup
            .table
            .as_ref()
            .is_some_and(|table| table.reaches(site.point))
        {
            return Err(Error::Input(format!(
                "press point {} is too close to the table; press elsewhere (--at x,y,z or --pick X,Y), or change gravity (--gravity x,y,z)",
                site.point
            )));
        }
        let depth = match wanted.force {
            Some(_) => MAX_DEPTH * site.thickness,
            None => wanted.depth.unwrap_or(DEPTH * site.thickness),
        };
        let question = Question {
            site,
            radius: setup.radius,
            depth,
            force: wanted.force,
            camera,
        };
        Ok((question, mesh))
    }
}
