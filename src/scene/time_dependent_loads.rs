//! Time-dependent pressures, prescribed displacements, muscles and tools of a scene.

use super::region::{self, LabelOrName};
use super::tool::ToolTrajectory;
use super::trajectory::{RigidTrajectory, second_difference, value_at};
use super::{FibreEntry, MoveEntry, MuscleEntry, PressureEntry, Scene, TimeSeries};
use crate::mesh::{BoundaryFace, Location, TetMesh, Topology};
use crate::physics::{
    AmplitudeId, Capability, Loads, Muscle, PrescribedMotionId, ScaledLoad, Simulator, SolverKind,
};
use crate::{Error, Result};
use glam::DVec3;

/// Smallest cosine between the normal of a face and the `facing` direction.
const MIN_FACING_COSINE: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// The time-dependent loads of a scene.
#[derive(Clone, Debug, Default)]
pub(super) struct TimeDependentLoads {
    pub scheduled_motions: Vec<ScheduledMotion>,
    pub tools: Vec<ToolTrajectory>,
    /// The amplitudes of pressures and muscles.
    pub levels: Vec<(AmplitudeId, TimeSeries)>,
}

/// Nodes with prescribed displacement along a path.
#[derive(Clone, Debug)]
pub(super) struct ScheduledMotion {
    /// Name in reaction files.
    pub name: String,
    pub nodes: Vec<u32>,
    id: PrescribedMotionId,
    rest: Vec<DVec3>,
    trajectory: RigidTrajectory,
    about: DVec3,
}

impl TimeDependentLoads {
    /// Applies the time-dependent loads of `scene` to its body, and adds notes.
    pub fn new(
        scene: &Scene,
        body: &mut dyn Simulator,
        notes: &mut Vec<String>,
    ) -> Result<TimeDependentLoads> {
        let mut actors = TimeDependentLoads::default();
        for (i, entry) in scene.tool.iter().enumerate() {
            let (guided, note) = entry.add_to(i, body)?;
            actors.tools.push(guided);
            notes.extend(note);
        }
        for (i, entry) in scene.moves.iter().enumerate() {
            actors
                .scheduled_motions
                .push(entry.scheduled_motion(i, body)?);
        }
        for entry in &scene.pressure {
            let acting = entry.acting(body)?;
            entry.pressure.check("pressure")?;
            let loads = Capability::Pressure.require(body.scaled_loads())?;
            let id = loads.add_scaled_load(acting)?;
            actors.levels.push((id, entry.pressure.clone()));
        }
        for entry in &scene.muscle {
            let acting = entry.acting(body.mesh())?;
            entry.activation.check("activation")?;
            let loads = Capability::Muscles.require(body.scaled_loads())?;
            let id = loads.add_scaled_load(acting)?;
            actors.levels.push((id, entry.activation.clone()));
        }
        // All amplitudes are checked here, before the first step.
        for (id, course) in &actors.levels {
            let keys: Vec<f64> = match course {
                TimeSeries::Steady(value) => vec![*value],
                TimeSeries::Keys(keys) => keys.iter().map(|key| key[1]).collect(),
            };
            let loads = Capability::Pressure.require(body.scaled_loads())?;
            keys.iter()
                .try_for_each(|value| loads.set_amplitude(*id, *value))?;
        }
        actors.apply(body, 0.0, 0.0)?;
        Ok(actors)
    }

    /// Whether any load depends on time.
    pub fn is_time_dependent(&self) -> bool {
        let keyed = |(_, course): &(AmplitudeId, TimeSeries)| matches!(course, TimeSeries::Keys(_));
        let tools = self.tools.iter().any(ToolTrajectory::moves);
        tools || !self.scheduled_motions.is_empty() || self.levels.iter().any(keyed)
    }

    /// Sets the tools to their initial poses.
    pub fn restart(&self, body: &mut dyn Simulator) -> Result<()> {
        let mut tools = self.tools.iter();
        tools.try_for_each(|tool| body.loads_mut().teleport_tool(tool.id, tool.pose(0.0)))
    }

    /// Sets all loads for the step of `dt` seconds (or 0) that begins at `time`.
    pub fn apply(&self, body: &mut dyn Simulator, time: f64, dt: f64) -> Result<()> {
        let kind = body.integrator();
        self.set_loads(body.loads_mut(), kind, (time, dt))
    }

    /// Sets all loads for the step of `dt` seconds (or 0) of the scheme `kind` that begins at
    /// `time`.
    pub fn set_loads(
        &self,
        loads: &mut Loads,
        kind: SolverKind,
        (time, dt): (f64, f64),
    ) -> Result<()> {
        for scheduled_motion in &self.scheduled_motions {
            let now = scheduled_motion.positions_at(time);
            let velocities: Vec<DVec3> = match dt > 0.0 {
                false => vec![DVec3::ZERO; now.len()],
                true => {
                    let then = scheduled_motion.positions_at(time + dt);
                    then.iter().zip(&now).map(|(b, a)| (*b - *a) / dt).collect()
                }
            };
            loads.set_prescribed_motion(scheduled_motion.id, &now, &velocities)?;
        }
        // Tools without a path are controlled interactively.
        for tool in self.tools.iter().filter(|tool| tool.moves()) {
            loads.set_tool_target(tool.id, tool.pose(time + dt))?;
        }
        // Time within the step at which the scheme evaluates forces.
        let at = match kind {
            SolverKind::Midpoint => time + 0.5 * dt,
            kind if kind.is_implicit() => time + dt,
            _ => time,
        };
        for (id, course) in &self.levels {
            loads.set_amplitude(*id, course.at(at));
        }
        Ok(())
    }
}

impl TimeSeries {
    pub(super) fn check(&self, what: &str) -> Result<()> {
        let TimeSeries::Keys(keys) = self else {
            return Ok(());
        };
        let ordered = keys.windows(2).all(|w| w[0][0] < w[1][0]);
        match !keys.is_empty() && ordered && keys.iter().flatten().all(|x| x.is_finite()) {
            true => Ok(()),
            false => Err(Error::Input(format!(
                "{what} must be a number, or a list of at least one [time, {what}] with increasing times"
            ))),
        }
    }

    fn at(&self, time: f64) -> f64 {
        match self {
            TimeSeries::Steady(value) => *value,
            TimeSeries::Keys(keys) => value_at(keys, time),
        }
    }
}

impl PressureEntry {
    fn acting(&self, body: &dyn Simulator) -> Result<ScaledLoad> {
        let (mesh, topology) = (body.mesh(), body.topology());
        let mut inside = vec![self.on.is_none(); mesh.nodes.len()];
        if let Some(on) = &self.on {
            on.nodes(mesh)?
                .iter()
                .for_each(|v| inside[*v as usize] = true);
        }
        let facing = self.normal.map(DVec3::from);
        if let Some(direction) =
            facing.filter(|direction| !(direction.is_finite() && direction.length() > 0.0))
        {
            return Err(Error::Input(format!(
                "`normal` of a [[pressure]] must be finite and not zero, got {direction}"
            )));
        }
        let wanted = |face: [u32; 3]| {
            let [a, b, c] = face.map(|v| mesh.nodes[v as usize]);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            face.iter().all(|v| inside[*v as usize])
                && facing
                    .is_none_or(|direction| normal.dot(direction.normalize()) >= MIN_FACING_COSINE)
        };
        let mut faces = match &self.between {
            Some(between) => faces_between(mesh, topology, between)?,
            None => topology.boundary.clone(),
        };
        faces.retain(|b| wanted(topology.boundary_nodes(mesh, *b)));
        if faces.is_empty() {
            let facing = facing.map_or(String::new(), |direction| {
                format!(" with a normal within 45° of {direction}")
            });
            return Err(Error::Input(format!(
                "a [[pressure]] acts on no face{facing}: no face {} has all its nodes {}; extend `on` or `normal`",
                self.between
                    .as_ref()
                    .map_or("of the boundary", |_| "of the interface of the two regions"),
                self.on
                    .as_ref()
                    .map_or("there".into(), |on| format!("in {on}"))
            )));
        }
        Ok(ScaledLoad::Pressure(faces))
    }
}

/// Returns the faces of the second region's tetrahedra that are adjacent to the first region.
fn faces_between(
    mesh: &TetMesh,
    topology: &Topology,
    between: &[LabelOrName; 2],
) -> Result<Vec<BoundaryFace>> {
    let labels = region::labels(mesh)?;
    let [pressing, pressed] = [between[0].label(mesh)?, between[1].label(mesh)?].map(|l| l as f64);
    let mut faces = Vec::new();
    for (t, neighbours) in topology.neighbours.iter().enumerate() {
        for (f, beyond) in neighbours.iter().enumerate() {
            // Boundary faces have no tetrahedron on the other side.
            let behind = labels.get(*beyond as usize / 4);
            if labels[t] == pressed && behind == Some(&pressing) {
                faces.push(BoundaryFace {
                    tet: t as u32,
                    face: f as u32,
                });
            }
        }
    }
    Ok(faces)
}

impl MoveEntry {
    fn scheduled_motion(&self, number: usize, body: &mut dyn Simulator) -> Result<ScheduledMotion> {
        let nodes = self.on.nodes(body.mesh())?;
        let trajectory = RigidTrajectory::new(
            "move",
            (self.path.as_deref(), self.file.as_deref()),
            (self.rotation.as_deref(), self.axis),
        )?;
        let mesh = &body.mesh().nodes;
        let rest: Vec<DVec3> = nodes.iter().map(|v| mesh[*v as usize]).collect();
        let middle = rest.iter().sum::<DVec3>() / rest.len() as f64;
        let id = body.add_prescribed_motion(&nodes)?;
        let name = self.name.clone();
        Ok(ScheduledMotion {
            name: name.unwrap_or_else(|| format!("move{}", number + 1)),
            nodes,
            id,
            rest,
            trajectory,
            about: self.pivot.map_or(middle, DVec3::from),
        })
    }
}

impl ScheduledMotion {
    /// Returns the node positions at `time`.
    pub fn positions_at(&self, time: f64) -> Vec<DVec3> {
        self.rest
            .iter()
            .map(|rest| self.place(*rest, time))
            .collect()
    }

    fn place(&self, rest: DVec3, time: f64) -> DVec3 {
        let (turned, moved) = self.trajectory.at(time);
        self.about + turned * (rest - self.about) + moved
    }

    /// Returns each node and its acceleration over the step of length `dt` that ended at `time`, in
    /// file units/s².
    pub fn accelerations(&self, time: f64, dt: f64) -> impl Iterator<Item = (u32, DVec3)> {
        let nodes = self.nodes.iter().zip(&self.rest);
        nodes.map(move |(v, rest)| (*v, second_difference(|t| self.place(*rest, t), time, dt)))
    }

    /// Applies a cut: duplicated nodes move like their originals.
    pub fn apply_cut(&mut self, doubled: &[[u32; 2]]) {
        for [new, old] in doubled {
            if let Some(k) = self.nodes.iter().position(|v| v == old) {
                self.nodes.push(*new);
                self.rest.push(self.rest[k]);
            }
        }
    }
}

impl MuscleEntry {
    fn acting(&self, mesh: &TetMesh) -> Result<ScaledLoad> {
        let tets = self.tets(mesh)?;
        let of_field = |name: &str| -> Result<Vec<DVec3>> {
            let field = mesh
                .field(name, Location::Cell)
                .filter(|f| f.components == 3);
            let field = field.ok_or_else(|| {
                Error::Input(format!(
                    "a [[muscle]] has fibre = \"{name}\", but the mesh has no cell field of that name with three components"
                ))
            })?;
            let vector = |t: &usize| DVec3::from_slice(&field.values[3 * t..3 * t + 3]);
            Ok(tets.iter().map(vector).collect())
        };
        let directions = match &self.fibre {
            Some(FibreEntry::Along(direction)) => vec![DVec3::from(*direction); tets.len()],
            Some(FibreEntry::Field(name)) => of_field(name)?,
            None => vec![longest(mesh, &tets); tets.len()],
        };
        let fibres = tets.iter().zip(&directions).map(|(t, direction)| {
            let unit = direction.normalize_or_zero();
            match unit == DVec3::ZERO {
                true => Err(Error::Input(format!(
                    "the fibre of tet {t} of a [[muscle]] must not be zero, got {direction}"
                ))),
                false => Ok((*t as u32, unit)),
            }
        });
        Ok(ScaledLoad::Muscle(Muscle {
            fibres: fibres.collect::<Result<_>>()?,
            tension: self.tension,
        }))
    }

    /// Returns the tetrahedra of its region.
    fn tets(&self, mesh: &TetMesh) -> Result<Vec<usize>> {
        let Some(region) = &self.region else {
            return Ok((0..mesh.tets.len()).collect());
        };
        let label = region.label(mesh)? as f64;
        let field = mesh.field("label", Location::Cell).or(mesh.region_field());
        let field = field.ok_or_else(|| {
            Error::Input(
                "a [[muscle]] of a region requires a cell field of integer region labels, such as `label`; the mesh has none".into(),
            )
        })?;
        let tets: Vec<usize> = (0..mesh.tets.len())
            .filter(|t| field.values[*t] == label)
            .collect();
        match tets.is_empty() {
            false => Ok(tets),
            true => Err(Error::Input(format!(
                "a [[muscle]] has no tets: no tet of the mesh has the label {label}"
            ))),
        }
    }
}

/// Returns the principal axis of largest variance of the volume-weighted centroids of the
/// tetrahedra.
fn longest(mesh: &TetMesh, tets: &[usize]) -> DVec3 {
    let middle = |t: usize| 0.25 * mesh.tet_nodes(t).iter().sum::<DVec3>();
    let volume: f64 = tets.iter().map(|t| mesh.tet_volume(*t)).sum();
    let sum = tets.iter().map(|t| mesh.tet_volume(*t) * middle(*t));
    let centre = sum.sum::<DVec3>() / volume;
    let mut spread = [[0.0; 3]; 3];
    for t in tets {
        let off = (middle(*t) - centre).to_array();
        for (i, row) in spread.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry += mesh.tet_volume(*t) * off[i] * off[j];
            }
        }
    }
    let (values, axes) = crate::physics::eigen(spread);
    let most = (0..3).max_by(|a, b| values[*a].total_cmp(&values[*b]));
    DVec3::from(axes[most.unwrap_or(0)])
}
