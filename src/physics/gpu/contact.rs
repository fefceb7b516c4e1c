//! Tools and the boundary surface on the GPU; the CPU side of `shaders/lib/tool.wgsl` and
//! `shaders/terms/contact.wgsl`.
//!
//! Contact points are those of the CPU engine (`cpu/contact/boundary_surface.rs`): the boundary
//! nodes, and lattices of points within faces that are large compared with a tool. A pass over
//! faces computes forces and blocks of the latter; a pass over nodes sums the contributions around
//! each node. The GPU stores the tool poses, because it advances them with accepted steps, and the
//! CPU does not yet know which steps were accepted.

use super::elements::GpuElements;
use crate::gpu::{Array, Gpu, PassBuilder, Texel};
use crate::physics::contact::{Shape, Tool, ToolMotion};
use crate::physics::cpu::{
    BoundarySurface, ReferenceToolContact, STATIC_FRICTION_SPEED, face_stiffnesses, tool_gap,
};
use crate::physics::loads::Loads;
use crate::physics::model::units::LocalUnits;
use crate::physics::{DiscreteModel, GpuBody, Reaction, ToolPose};
use crate::{Error, Result};
use glam::DVec3;
use std::collections::BTreeMap;

pub(in crate::physics) mod gpu_data {
    crate::gpu_struct! {
        /// See `shaders/lib/tool.wgsl`.
        pub struct Tool {
            pub dimensions: [f32; 4],
            pub contact_parameters: [f32; 4],
            pub motion_limits: [f32; 4],
            pub low: [f32; 4],
            pub grid: [u32; 4],
            pub start_position: [f32; 4],
            pub start_rotation: [f32; 4],
            pub target_position: [f32; 4],
            pub target_rotation: [f32; 4],
            pub current_position: [f32; 4],
            pub current_rotation: [f32; 4],
            pub previous_position: [f32; 4],
            pub previous_rotation: [f32; 4],
            pub friction_position: [f32; 4],
            pub friction_rotation: [f32; 4],
            pub accepted_position: [f32; 4],
            pub accepted_rotation: [f32; 4],
        }
    }
    crate::gpu_struct! {
        /// See `shaders/lib/tool.wgsl`.
        pub struct ContactStepState {
            pub stage: u32,
            pub stages: u32,
            pub tracks_tool: u32,
            pub is_first_system: u32,
            pub newton_iteration: u32,
            pub friction_updates: u32,
            pub update_lagged_friction: u32,
            pub done: u32,
            pub cg_batches: u32,
            pub line_search_trials: u32,
            pub trial_length: f32,
            pub last_length: f32,
            pub bracket_low: f32,
            pub high: f32,
            pub low_slope: f32,
            pub high_slope: f32,
            pub activation_distance: f32,
            pub may_contact: u32,
            pub had_no_contact: u32,
            pub min_residual_squared: f32,
            pub stalled_iterations: u32,
            pub step_found: u32,
            pub steps: u32,
        }
    }
}

/// Texels per face, and per node.
const FACE_TEXELS: usize = 15;
pub(in crate::physics) const NODE_TEXELS: usize = 3;

/// Marks an edge without a second face.
const NO_FACE: u32 = u32::MAX;

/// Maximum penetration of an accepted step, over the smaller of the tool's size and the boundary's
/// edge length.
const MAX_PENETRATION_RATIO: f64 = 0.02;

/// Initial activation distance of moving tools, over the boundary's edge length.
const INITIAL_ACTIVATION_DISTANCE: f64 = 0.1;

/// Maximum motion of a tool per stage, over the smaller of the boundary's edge length and half of
/// the tool's thickness.
const MAX_STAGE_STEP: f64 = 0.5;

/// The tools of a body, and its boundary surface.
pub(in crate::physics) struct GpuContact {
    gpu: Gpu,
    hull: BoundarySurface,
    records: Vec<ToolRecord>,
    pub tools: wgpu::Buffer,
    pub fields: wgpu::Buffer,
    pub contact_state: wgpu::Buffer,
    pub corners: Array,
    pub face_weights: Array,
    pub boundary_nodes: Array,
    pub around_nodes: Array,
    pub edge_faces: Array,
    pub faces: Array,
    pub node_contributions: Array,
    /// The speed threshold ε of static friction.
    pub static_friction_speed: f64,
    /// The initial activation distance of moving tools.
    pub initial_activation_distance: f64,
}

/// A tool as given, its shape in local units, and its teleport count.
#[derive(Debug)]
struct ToolRecord {
    shape: Shape,
    friction: f64,
    gap: f64,
    teleport_count: u64,
}

impl std::fmt::Debug for GpuContact {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GpuContact")
            .field("tools", &self.records)
            .finish_non_exhaustive()
    }
}

/// The lists from which the arrays of a boundary are created.
struct Lists {
    corners: Vec<[u32; 4]>,
    weights: Vec<f32>,
    nodes: Vec<[u32; 4]>,
    around: Vec<u32>,
    sides: Vec<[u32; 2]>,
}

impl Lists {
    fn new(hull: &BoundarySurface, ends: &[[u32; 2]]) -> Lists {
        let mut around: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        let mut edge_sides: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
        let mut corners = Vec::with_capacity(hull.faces.len());
        for (f, (face, _)) in hull.faces.iter().enumerate() {
            let mut longest = 0.0f64;
            for c in 0..3 {
                let (a, b) = (face[c], face[(c + 1) % 3]);
                let number = (3 * f + c) as u32;
                around.entry(a).or_default().push(number);
                edge_sides
                    .entry([a.min(b), a.max(b)])
                    .or_default()
                    .push(number);
                longest = longest.max(hull.rest[a as usize].distance(hull.rest[b as usize]));
            }
            corners.push([face[0], face[1], face[2], (longest as f32).to_bits()]);
        }
        let mut lists = Lists {
            corners,
            weights: hull
                .faces
                .iter()
                .map(|(_, weight)| *weight as f32)
                .collect(),
            nodes: Vec::new(),
            around: Vec::new(),
            sides: Vec::new(),
        };
        for (node, weight) in &hull.nodes {
            let entries = around.get(node).map_or(&[][..], Vec::as_slice);
            let first = lists.around.len() as u32;
            let bits = (*weight as f32).to_bits();
            lists.nodes.push([*node, first, entries.len() as u32, bits]);
            lists.around.extend(entries);
        }
        let side = |[a, b]: &[u32; 2]| {
            let entries = edge_sides.get(&[*a.min(b), *a.max(b)]);
            let entries = entries.map_or(&[][..], Vec::as_slice);
            [0, 1].map(|s| entries.get(s).copied().unwrap_or(NO_FACE))
        };
        lists.sides = ends.iter().map(side).collect();
        lists
    }
}

/// The boundary surface of the faces `faces` of `model`, in local units.
pub(in crate::physics) fn boundary_surface(
    model: &DiscreteModel,
    faces: &[[u32; 3]],
    units: &LocalUnits,
) -> BoundarySurface {
    let rest = model
        .rest_positions
        .iter()
        .map(|x| *x / units.length)
        .collect();
    let faces: Vec<([u32; 3], f64)> = face_stiffnesses(faces, model, units).collect();
    BoundarySurface::new(rest, &faces)
}

impl GpuContact {
    /// `tools` with the poses in `loads`, on the boundary `faces` of the body of `model` and
    /// `elements`.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the arrays do not fit the device.
    pub fn new(
        gpu: &Gpu,
        (model, elements, units): (&DiscreteModel, &GpuElements, &LocalUnits),
        faces: &[[u32; 3]],
        (tools, loads): (&[Tool], &Loads),
    ) -> Result<GpuContact> {
        let hull = boundary_surface(model, faces, units);
        let unit = model.length_unit / units.length;
        let records = tools
            .iter()
            .zip(loads.tools())
            .map(|(tool, (_, teleport_count))| {
                let shape = tool.shape.with_scale(unit);
                ToolRecord {
                    gap: tool_gap(tool, &shape, hull.edge, unit),
                    friction: tool.friction,
                    teleport_count: *teleport_count,
                    shape,
                }
            });
        let records: Vec<ToolRecord> = records.collect();
        let lists = Lists::new(&hull, elements.ends());
        let (mut data, mut values) = (Vec::new(), Vec::new());
        for (tool, (pose, _)) in records.iter().zip(loads.tools()) {
            let at = gpu_pose(loads, pose);
            data.push(tool_data(tool, hull.edge, at, &mut values));
        }
        let nodes = model.rest_positions.len();
        Ok(GpuContact {
            tools: gpu.buffer_of("tools", &data)?,
            fields: gpu.buffer_of("distances", &values)?,
            contact_state: gpu.buffer_of(
                "tool parameters",
                &[<gpu_data::ContactStepState as bytemuck::Zeroable>::zeroed()],
            )?,
            corners: gpu.array_of("boundary faces", Texel::U32x4, &lists.corners)?,
            face_weights: gpu.array_of("face weights", Texel::F32, &lists.weights)?,
            boundary_nodes: gpu.array_of("boundary nodes", Texel::U32x4, &lists.nodes)?,
            around_nodes: gpu.array_of("faces of nodes", Texel::U32, &lists.around)?,
            edge_faces: gpu.array_of("faces of edges", Texel::U32x2, &lists.sides)?,
            faces: gpu.array("face contact", Texel::F32x4, FACE_TEXELS * hull.faces.len())?,
            node_contributions: gpu.array("node contact", Texel::F32x4, NODE_TEXELS * nodes)?,
            gpu: gpu.clone(),
            static_friction_speed: STATIC_FRICTION_SPEED * units.time,
            initial_activation_distance: INITIAL_ACTIVATION_DISTANCE * hull.edge,
            records,
            hull,
        })
    }

    /// Whether any tool has friction.
    pub fn has_friction(&self) -> bool {
        self.records.iter().any(|tool| tool.friction > 0.0)
    }

    /// Sets the tool targets at the end of the next step, and teleports tools whose count changed.
    pub fn set_tool_targets(&mut self, loads: &Loads) {
        for (k, (pose, teleport_count)) in loads.tools().iter().enumerate() {
            let Some(tool) = self.records.get_mut(k) else {
                return;
            };
            let teleports =
                std::mem::replace(&mut tool.teleport_count, *teleport_count) != *teleport_count;
            self.write_pose(k, gpu_pose(loads, pose), teleports);
        }
    }

    /// Puts the tools at their targets, as needed after restoring a state.
    pub fn reset_tools(&mut self, loads: &Loads) {
        for (k, (pose, teleport_count)) in loads.tools().iter().enumerate() {
            if let Some(tool) = self.records.get_mut(k) {
                tool.teleport_count = *teleport_count;
                self.write_pose(k, gpu_pose(loads, pose), true);
            }
        }
    }

    fn write_pose(&self, k: usize, at: [[f32; 4]; 2], teleports: bool) {
        use std::mem::offset_of;
        let first = k * size_of::<gpu_data::Tool>();
        let write = |offset: usize| {
            let bytes = bytemuck::bytes_of(&at);
            let at = (first + offset) as u64;
            self.gpu.queue().write_buffer(&self.tools, at, bytes);
        };
        write(offset_of!(gpu_data::Tool, target_position));
        if teleports {
            write(offset_of!(gpu_data::Tool, start_position));
            write(offset_of!(gpu_data::Tool, accepted_position));
        }
    }

    /// Returns the force of the body on each tool and its moment about the origin of the tool's
    /// shape, in local units, computed in float64 from local positions and velocities after a step
    /// of `time`.
    ///
    /// # Errors
    /// Errors of reading back.
    pub fn reactions(
        &self,
        [positions, velocities]: [&[[f32; 4]]; 2],
        masses: &[[f32; 2]],
        time: f64,
    ) -> Result<Vec<[DVec3; 2]>> {
        let tools: Vec<gpu_data::Tool> = self.gpu.read_buffer(&self.tools)?;
        let widen = |x: [f32; 4]| x.map(f64::from);
        let paths: Vec<ToolMotion> = tools
            .iter()
            .map(|tool| ToolMotion {
                from: [widen(tool.start_position), widen(tool.start_rotation)],
                to: [widen(tool.accepted_position), widen(tool.accepted_rotation)],
            })
            .collect();
        let u = self.displacements(positions);
        let v: Vec<[f64; 4]> = velocities
            .iter()
            .map(|v| widen([v[0], v[1], v[2], 0.0]))
            .collect();
        let free = masses.iter().map(|m| f64::from(u8::from(m[1] != 0.0)));
        let free: Vec<f64> = free.collect();
        Ok(self.reference().reactions([&u, &v], &free, &paths, time))
    }

    /// The same tools and boundary in float64.
    pub fn reference(&self) -> ReferenceToolContact {
        let mut reference =
            ReferenceToolContact::new(self.hull.clone(), self.static_friction_speed);
        for tool in &self.records {
            reference.add(tool.shape.clone(), tool.friction, tool.gap);
        }
        reference
    }

    /// Displacements of nodes at local positions from their rest positions.
    pub fn displacements(&self, positions: &[[f32; 4]]) -> Vec<[f64; 4]> {
        let moved = |([x, y, z, _], rest): (&[f32; 4], &DVec3)| {
            let u = DVec3::new(f64::from(*x), f64::from(*y), f64::from(*z)) - *rest;
            [u.x, u.y, u.z, 0.0]
        };
        positions.iter().zip(&self.hull.rest).map(moved).collect()
    }

    /// Binds the declarations of `terms/contact` in a program.
    pub fn bind<'a>(&'a self, pass: PassBuilder<'a>) -> PassBuilder<'a> {
        pass.read(&self.node_contributions)
    }
}

/// Position and rotation of a pose in the GPU's format.
fn gpu_pose(loads: &Loads, pose: &ToolPose) -> [[f32; 4]; 2] {
    let (frame, _) = loads.frame_and_unit();
    let position = frame.to_local(pose.position());
    let rotation = pose.rotation().normalize().to_array();
    [position.extend(0.0).to_array(), rotation.map(|x| x as f32)]
}

/// The data of a tool in its pose; appends the values of its distance field to those of the others.
fn tool_data(
    tool: &ToolRecord,
    edge: f64,
    [position, rotation]: [[f32; 4]; 2],
    values: &mut Vec<f32>,
) -> gpu_data::Tool {
    let shape = &tool.shape;
    // Planes have infinite values here.
    let clamp_to_f32 = |x: f64| x.min(f64::from(f32::MAX)) as f32;
    let (mut low, mut grid) = ([0.0; 4], [0; 4]);
    let dimensions = match shape {
        Shape::Sphere { radius } => [*radius, 0.0, 0.0, 0.0],
        Shape::Capsule { radius, length } => [*radius, 0.5 * length, 0.0, 1.0],
        Shape::Box { half } => [half.x, half.y, half.z, 2.0],
        Shape::Plane => [0.0, 0.0, 0.0, 3.0],
        Shape::Sdf(field) => {
            let (first, counts, entries, unit) = field.grid();
            low = [first.x, first.y, first.z, field.spacing()].map(|x| x as f32);
            let [x, y, z] = counts.map(|n| n as u32);
            grid = [x, y, z, values.len() as u32];
            values.extend(entries.iter().map(|v| *v as f32));
            [unit, 0.0, 0.0, 4.0]
        }
    };
    let stage_step = MAX_STAGE_STEP * edge.min(shape.half_thickness());
    let half = shape.half_thickness();
    gpu_data::Tool {
        dimensions: dimensions.map(|x| x as f32),
        contact_parameters: [
            tool.friction as f32,
            tool.gap as f32,
            clamp_to_f32(half),
            clamp_to_f32(shape.feature_size()),
        ],
        motion_limits: [
            (MAX_PENETRATION_RATIO * shape.feature_size().min(edge)) as f32,
            stage_step as f32,
            clamp_to_f32(shape.bounding_radius()),
            0.0,
        ],
        low,
        grid,
        start_position: position,
        start_rotation: rotation,
        target_position: position,
        target_rotation: rotation,
        current_position: position,
        current_rotation: rotation,
        previous_position: position,
        previous_rotation: rotation,
        friction_position: position,
        friction_rotation: rotation,
        accepted_position: position,
        accepted_rotation: rotation,
    }
}

impl GpuBody {
    /// Checks that the GPU supports tools on this body.
    ///
    /// # Errors
    /// [`Error::Input`] for a body with rigid regions.
    pub(in crate::physics) fn check_tools(&self) -> Result<()> {
        match self.rigid {
            None => Ok(()),
            Some(_) => Err(Error::Input(
                "tools on bodies with rigid regions are supported on the CPU only; use the engine cpu or auto (--engine)".into(),
            )),
        }
    }

    /// Returns the reaction on each tool after steps of `dt` seconds.
    ///
    /// # Errors
    /// Errors of reading back.
    pub(in crate::physics) fn tool_forces(&self, dt: f64) -> Result<Vec<Reaction>> {
        let Some(contact) = &self.contact else {
            return Ok(Vec::new());
        };
        let positions: Vec<[f32; 4]> = self.nodes.local()?;
        let velocities: Vec<[f32; 4]> = self.gpu.read_array(&self.velocities)?;
        let masses: Vec<[f32; 2]> = self.gpu.read_array(&self.masses)?;
        let time = dt / self.units.time;
        let local = contact.reactions([&positions, &velocities], &masses, time)?;
        let units = [self.units.force(), self.units.energy()];
        let reaction = |[force, moment]: &[DVec3; 2]| Reaction {
            force: *force * units[0],
            moment: *moment * units[1],
        };
        Ok(local.iter().map(reaction).collect())
    }

    /// Sets the tools that press on the boundary `faces`, with the poses in the loads.
    ///
    /// # Errors
    /// As [`GpuBody::check_tools`]; [`Error::Gpu`] if the arrays do not fit the device.
    pub(in crate::physics) fn set_tools(
        &mut self,
        tools: &[Tool],
        faces: &[[u32; 3]],
    ) -> Result<()> {
        self.check_tools()?;
        let Some(elements) = self.elements() else {
            return Ok(());
        };
        let of = (&self.model, elements, &self.units);
        self.contact = Some(GpuContact::new(&self.gpu, of, faces, (tools, &self.loads))?);
        self.generation += 1;
        self.mark_changed();
        Ok(())
    }
}
