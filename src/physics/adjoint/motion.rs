//! Gradients of a quantity of a moving body: its steps in reverse.
//!
//! The states of all steps are kept if they fit [`STATE_MEMORY`]. Otherwise checkpoints are kept
//! every √n steps, and the steps between two of them are taken again, so that forward and reverse
//! take at most 2n steps. Several numbers of one motion share the forward pass.

use super::equilibrium::{Equilibrium, MeasuredForces};
use super::parameters::{ModelNumbers, Sensitivity};
use super::quantities::prepare;
use crate::physics::cpu::{
    AdjointSeed, LoadUpdate, MotionAdjoint, MotionState, StateAdjoint, StepFailure, StepLoads,
    StepParts,
};
use crate::physics::{Gradient, Parameter, Quantity, SeriesReader, SolverKind, StepRecord};
use crate::progress::{ProgressFn, ProgressScope};
use crate::{Error, Result};
use glam::DVec3;

/// Bytes of the states of steps that are kept.
pub(super) const STATE_MEMORY: usize = 1 << 30;

/// Largest residual of a step over its forces.
const MAX_RESIDUAL: f64 = 1e-3;

/// A number that the motion of a body determines.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum MotionQuantity {
    /// The quantity at the end.
    AtEnd(Quantity),
    /// The sum of the values of the quantity after every step, times the length of the step.
    Integral(Quantity),
    /// Numbers that the values of the quantity after all steps determine.
    Series(Quantity),
}

impl MotionQuantity {
    /// Returns the quantity at one time.
    pub fn at_one_time(&self) -> &Quantity {
        match self {
            MotionQuantity::AtEnd(quantity)
            | MotionQuantity::Integral(quantity)
            | MotionQuantity::Series(quantity) => quantity,
        }
    }
}

/// The gradient of a motion that is to be computed.
pub(super) struct MotionTask<'a> {
    /// Number of steps, of a series the most.
    pub steps: u32,
    /// Length of a step, s.
    pub dt: f64,
    pub scheme: SolverKind,
    pub quantity: &'a MotionQuantity,
    pub parameters: &'a [Parameter],
    /// Bytes of the states that are kept.
    pub memory: usize,
    pub parts: StepParts,
    pub progress: ProgressFn<'a>,
    /// Returns the error of a step that failed after a number of others.
    pub error: &'a dyn Fn(StepFailure, u32) -> Error,
}

/// A motion, which may have ended early, and its gradient.
pub(super) struct MotionResult {
    /// Steps of the motion that were taken, and all steps with those that were taken again.
    pub taken: u32,
    pub computed: u32,
    /// The record of the last step of the motion.
    pub last: Option<StepRecord>,
    /// One gradient, of a series one for each number.
    pub gradients: Result<Vec<Gradient>>,
}

/// Runs the motion of `body`, whose engine is `engine`, forward and back. The engine ends at the
/// end of the motion, also if the gradient fails.
///
/// `loads` returns those of the step of an index, if they change; `read` is that of a series.
pub(super) fn gradients_of_motion(
    body: Equilibrium<'_>,
    engine: &mut dyn MotionAdjoint,
    task: &MotionTask<'_>,
    loads: &mut dyn FnMut(u32) -> Result<Option<LoadUpdate>>,
    read: SeriesReader<'_>,
) -> MotionResult {
    let mut result = MotionResult {
        taken: 0,
        computed: 0,
        last: None,
        gradients: Ok(Vec::new()),
    };
    let begun = check_task(&body, task).and_then(|()| engine.begin_motion());
    let (first, settings) = match begun {
        Ok(begun) => begun,
        Err(error) => {
            result.gradients = Err(error);
            return result;
        }
    };
    let all = (task.steps as usize + 1) * engine.motion_state_bytes();
    let segment = match all <= task.memory {
        true => task.steps,
        false => f64::from(task.steps).sqrt().ceil() as u32,
    };
    let mut pass = Pass {
        numbers: ModelNumbers::new(&body),
        body,
        engine,
        task,
        loads,
        segment: segment.max(1),
        states: vec![first],
        checkpoints: Vec::new(),
        outputs: Vec::new(),
    };
    let forward = pass.forward(&mut result, read);
    result.gradients = forward.and_then(|()| {
        let end = pass.engine.serialise_state()?;
        let reverse = pass.reverse(result.taken, &mut result.computed);
        // A state resumes with the loads of its last step.
        if let Some(last) = (pass.loads)(result.taken - 1)? {
            pass.engine.apply_loads(last)?;
        }
        pass.engine.resume(&end)?;
        reverse
    });
    pass.engine.end_motion(settings);
    result
}

/// Checks all that can be wrong before the first step.
fn check_task(body: &Equilibrium<'_>, task: &MotionTask<'_>) -> Result<()> {
    if task.steps == 0 {
        return Err(Error::Input(
            "the gradient of a motion requires at least one step".into(),
        ));
    }
    let is_damped = body.network.damping_time > 0.0;
    let averages = |e: &crate::physics::Elements| !e.cells().cells.is_empty();
    if is_damped && body.network.elements().is_some_and(averages) {
        return Err(Error::Input(
            "there is no gradient of a motion with averaged volumes and stiffness-proportional damping; set damping to 0, or remove volume (--volume)".into(),
        ));
    }
    let quantity = task.quantity.at_one_time();
    match quantity {
        Quantity::PinReaction { .. } | Quantity::RegionForce { .. }
            if is_damped || body.has_friction() =>
        {
            return Err(Error::Input(
                "there is no gradient of the force on supports or rigid regions in a motion with stiffness-proportional damping or friction; set damping and friction to 0".into(),
            ));
        }
        // A body that has not moved yet has none.
        Quantity::LargestDisplacement => {}
        _ => drop(prepare(quantity, body)?),
    }
    for parameter in task.parameters {
        body.check_parameter(parameter)?;
        check_rigid(body, task.scheme, parameter)?;
        if is_damped && matches!(parameter, Parameter::RestPosition { .. }) {
            return Err(Error::Input(
                "there is no derivative by rest positions of a motion with stiffness-proportional damping; set damping to 0".into(),
            ));
        }
    }
    Ok(())
}

/// Checks that a parameter is none of those that rigid regions have no derivatives by.
fn check_rigid(body: &Equilibrium<'_>, scheme: SolverKind, parameter: &Parameter) -> Result<()> {
    let is_midpoint = scheme == SolverKind::Midpoint;
    let refuse_masses = |tets: &mut dyn Iterator<Item = u32>| {
        let mut nodes = tets.flat_map(|t| body.mesh.tets[t as usize]);
        match nodes.any(|v| body.is_rigid(v)) {
            false => Ok(()),
            true => Err(Error::Input(
                "a motion by the midpoint rule has no derivative by the masses of rigid regions; use implicit or bdf2, or tets and nodes that no rigid region is adjacent to".into(),
            )),
        }
    };
    match parameter {
        Parameter::InitialPosition { node, .. } | Parameter::InitialVelocity { node, .. }
            if body.is_rigid(*node) =>
        {
            Err(Error::Input(format!(
                "node {node} belongs to a rigid region, which begins in the pose and with the momentum that fit all of its nodes; choose a node of the soft tissue"
            )))
        }
        Parameter::MassDamping if is_midpoint && !body.network.rigid_bodies().is_empty() => {
            Err(Error::Input(
                "a motion of rigid regions by the midpoint rule has no derivative by mass-proportional damping; use implicit or bdf2".into(),
            ))
        }
        Parameter::Density { tets } if is_midpoint => refuse_masses(&mut tets.iter().copied()),
        Parameter::RestPosition { node, .. } if is_midpoint => {
            let all = 0..body.mesh.tets.len();
            let around = all.filter(|t| body.mesh.tets[*t].contains(node));
            refuse_masses(&mut around.map(|t| t as u32))
        }
        _ => Ok(()),
    }
}

/// The passes over the steps of a motion.
struct Pass<'a, 'b> {
    body: Equilibrium<'a>,
    engine: &'b mut dyn MotionAdjoint,
    task: &'b MotionTask<'b>,
    loads: &'b mut dyn FnMut(u32) -> Result<Option<LoadUpdate>>,
    numbers: ModelNumbers,
    /// Number of steps whose states are kept.
    segment: u32,
    /// States of the current segment, from its start.
    states: Vec<MotionState>,
    /// Packed states at the start of every segment, if there are several.
    checkpoints: Vec<Vec<u8>>,
    outputs: Vec<Output>,
}

/// A number of a motion, and its gradient as far as the reverse has come.
struct Output {
    /// Its derivatives by the value of the quantity after each step.
    weights: Vec<f64>,
    /// Its value, if it is not the sum of weights times values.
    value: Option<f64>,
    /// Derivatives by the state that the reverse has reached; `None` behind the last weight.
    adjoint: Option<StateAdjoint>,
    sums: Gradient,
}

impl Pass<'_, '_> {
    /// Takes the steps of the motion, and finds the numbers that are differentiated.
    fn forward(&mut self, result: &mut MotionResult, read: SeriesReader<'_>) -> Result<()> {
        let mut values = Vec::new();
        for i in 0..self.task.steps {
            let share = 0.5 * f64::from(i) / f64::from(self.task.steps);
            ProgressScope::begin(self.task.progress, "steps", share)?;
            if i % self.segment == 0 && self.segment < self.task.steps {
                self.checkpoints.push(self.engine.serialise_state()?);
                self.states.drain(..self.states.len() - 1);
            }
            result.last = Some(self.step(i)?);
            result.taken += 1;
            result.computed += 1;
            if let MotionQuantity::Series(quantity) = self.task.quantity {
                values.push(self.value_now(quantity)?);
                if let Some(numbers) = read(&values)? {
                    let numbers = numbers.into_iter();
                    let outputs = numbers.map(|(value, by)| self.output(by, Some(value)));
                    self.outputs = outputs.collect();
                    return Ok(());
                }
            }
        }
        let weights = match self.task.quantity {
            MotionQuantity::Integral(_) => vec![self.task.dt; self.task.steps as usize],
            MotionQuantity::AtEnd(_) => {
                let last = |i| f64::from(u8::from(i + 1 == self.task.steps));
                (0..self.task.steps).map(last).collect()
            }
            MotionQuantity::Series(_) => {
                return Err(Error::Input(format!(
                    "{} steps of the motion do not determine the numbers of a series; take more",
                    self.task.steps
                )));
            }
        };
        self.outputs = vec![self.output(weights, None)];
        Ok(())
    }

    /// Creates a number with its derivatives by the values after each step.
    fn output(&self, weights: Vec<f64>, value: Option<f64>) -> Output {
        Output {
            weights,
            value,
            adjoint: None,
            sums: Gradient {
                derivatives: vec![0.0; self.task.parameters.len()],
                ..Gradient::default()
            },
        }
    }

    /// Returns a quantity of the state after the last step.
    fn value_now(&mut self, quantity: &Quantity) -> Result<f64> {
        self.measure();
        if let Some(state) = self.states.last() {
            set_levels(&mut self.body, state);
        }
        let (_, value, _) = prepare(quantity, &self.body)?.into_seed(&self.body);
        Ok(value)
    }

    /// Measures the positions and the forces of the engine.
    fn measure(&mut self) {
        self.body.x = self.engine.positions();
        self.body.inertia.clear();
        self.body.forces = MeasuredForces {
            tools: self.engine.tool_forces(),
            nodes: self.engine.forces(),
            rigid: self.engine.rigid_forces(),
        };
    }

    /// Takes the step of index `i`, and keeps its state.
    fn step(&mut self, i: u32) -> Result<StepRecord> {
        let change = (self.loads)(i)?;
        let loads = self.engine.begin_step(change)?;
        let done = self.engine.motion_step(self.task.dt);
        let record = done.map_err(|why| (self.task.error)(why, i))?;
        self.states.push(self.engine.motion_state(loads));
        Ok(record)
    }

    /// Takes the steps of a segment again.
    fn recompute(&mut self, k: usize, computed: &mut u32) -> Result<()> {
        self.engine.resume(&self.checkpoints[k])?;
        self.states.clear();
        self.states
            .push(self.engine.motion_state(StepLoads::default()));
        for i in 0..self.segment {
            self.step(k as u32 * self.segment + i)?;
            *computed += 1;
        }
        Ok(())
    }

    /// Returns the numbers and their derivatives, from the last of the steps to the first.
    fn reverse(&mut self, steps: u32, computed: &mut u32) -> Result<Vec<Gradient>> {
        let segments = steps.div_ceil(self.segment);
        for k in (0..segments).rev() {
            if k + 1 < segments {
                self.recompute(k as usize, computed)?;
            }
            for j in (1..self.states.len()).rev() {
                let step = k * self.segment + j as u32;
                let left = f64::from(step) / f64::from(steps);
                ProgressScope::begin(self.task.progress, "gradient", 1.0 - 0.5 * left)?;
                for k in 0..self.outputs.len() {
                    let weights = &self.outputs[k].weights;
                    let weight = weights.get(step as usize - 1).copied().unwrap_or(0.0);
                    if weight != 0.0 {
                        self.add_quantity(j, k, weight)?;
                    }
                }
                self.reverse_step(j)?;
            }
        }
        for k in 0..self.outputs.len() {
            self.add_start(k);
        }
        let outputs = std::mem::take(&mut self.outputs).into_iter();
        Ok(outputs
            .map(|output| Gradient {
                value: output.value.unwrap_or(output.sums.value),
                ..output.sums
            })
            .collect())
    }

    /// Adds the quantity after the step `j` of the segment to the number `k`, and its own derivatives.
    fn add_quantity(&mut self, j: usize, k: usize, weight: f64) -> Result<()> {
        self.engine.show_state(&self.states[j])?;
        set_levels(&mut self.body, &self.states[j]);
        self.measure();
        let prepared = prepare(self.task.quantity.at_one_time(), &self.body)?;
        let (seed, value, function) = prepared.into_seed(&self.body);
        let output = &mut self.outputs[k];
        let adjoint = output.adjoint.get_or_insert_default();
        let own = self.engine.add_quantity(&seed, weight, adjoint);
        output.sums.value += weight * value;
        let sensitivity = Sensitivity::new(&self.body, &self.numbers, own, function);
        add_derivatives(&mut output.sums, &sensitivity, self.task.parameters, weight)
    }

    /// Turns the derivatives by the state after the step `j` of the segment into those by the state before it.
    fn reverse_step(&mut self, j: usize) -> Result<()> {
        let begun = self.outputs.iter_mut();
        let begun = begun.filter_map(|own| Some((own.adjoint.as_mut()?, &mut own.sums)));
        let (mut adjoints, sums): (Vec<&mut StateAdjoint>, Vec<&mut Gradient>) = begun.unzip();
        if adjoints.is_empty() {
            return Ok(());
        }
        let seed = AdjointSeed {
            amplitudes: self.body.amplitudes.len(),
            ..AdjointSeed::default()
        };
        set_levels(&mut self.body, &self.states[j]);
        let with = (self.body.network, &seed, self.task.parts);
        let states = [&self.states[j - 1], &self.states[j]];
        let found = self
            .engine
            .reverse_step(states, self.task.dt, with, &mut adjoints)?;
        for (found, sums) in found.into_iter().zip(sums) {
            if found.residual > MAX_RESIDUAL {
                return Err(Error::Input(format!(
                    "a step of the motion did not converge: its net force is {:.1e} times its largest force; take shorter steps",
                    found.residual
                )));
            }
            sums.imbalance = sums.imbalance.max(found.residual);
            sums.iterations += found.solution.iterations;
            (self.body.x, self.body.inertia) = (found.positions, found.inertia);
            let sensitivity = Sensitivity::new(&self.body, &self.numbers, found.solution, None);
            add_derivatives(sums, &sensitivity, self.task.parameters, 1.0)?;
        }
        Ok(())
    }

    /// Adds the derivatives of the number `k` through the first state.
    fn add_start(&mut self, k: usize) {
        let Output { adjoint, sums, .. } = &mut self.outputs[k];
        let Some(adjoint) = adjoint else {
            return;
        };
        let [by_position, by_velocity] = self.engine.by_state(adjoint);
        let body = &self.body;
        let unit = body.network.length_unit;
        let start = |parameter: &Parameter| -> f64 {
            let along = |of: &[DVec3], nodes: &[u32], direction: &DVec3| -> f64 {
                let all = nodes.iter().map(|v| of[*v as usize].dot(*direction));
                all.sum::<f64>() * unit
            };
            match parameter {
                Parameter::Support { nodes, direction } => along(&by_position, nodes, direction),
                Parameter::InitialPosition { node, direction } => {
                    along(&by_position, &[*node], direction)
                }
                Parameter::InitialVelocity { node, direction } => {
                    along(&by_velocity, &[*node], direction)
                }
                // Displacements at the start stay; held nodes stay where they are.
                Parameter::RestPosition { node, direction } => {
                    let v = *node as usize;
                    match body.fixed[v] && !body.pinned[v] {
                        true => 0.0,
                        false => along(&by_position, &[*node], direction),
                    }
                }
                _ => 0.0,
            }
        };
        let all = sums.derivatives.iter_mut().zip(self.task.parameters);
        for (sum, parameter) in all {
            *sum += start(parameter);
        }
    }
}

/// Sets the amplitudes of the body to those of the step to a state.
fn set_levels(body: &mut Equilibrium<'_>, state: &MotionState) {
    let levels = state.levels();
    if levels.len() == body.amplitudes.len() {
        body.amplitudes.copy_from_slice(levels);
    }
}

fn add_derivatives(
    sums: &mut Gradient,
    sensitivity: &Sensitivity<'_>,
    parameters: &[Parameter],
    weight: f64,
) -> Result<()> {
    for (sum, parameter) in sums.derivatives.iter_mut().zip(parameters) {
        *sum += weight * sensitivity.by_parameter(parameter)?;
    }
    Ok(())
}
