//! Tools of a body, as they are set and read from outside.

use super::body::{CpuBody, Start};
use super::contact::{Contact, Pressing, ToolPlace};
use super::contact_hull::Hull;
use super::newton_contact::{clear, contact, contact_mut, touching};
use super::real::Real;
use super::self_contact::Touching;
use super::terms::At;
#[cfg(feature = "rapier")]
use crate::physics::ConjugateGradients;
use crate::physics::contact::check_pose;
use crate::physics::{SelfContact, Shape, SolverKind, SpringNetwork, Tool, ToolPose, Units};
use crate::{Error, Result};
use glam::DVec3;

/// The gap from which on a tool pushes, where none is given: over its size, and over the mean edge
/// of the body's boundary.
const OF_SIZE: f64 = 1.0 / 2000.0;
const OF_EDGE: f64 = 1.0 / 100.0;

/// The gap from which on parts of a body push each other, over the mean edge of its boundary.
const BETWEEN: f64 = 1.0 / 20.0;

/// And at least, over the extent of the body: f32 resolves a hundredth of it.
const LEAST: f64 = 2e-5;

/// The speed below which friction holds, in extents of the body a second.
pub(in crate::physics) const HOLDS: f64 = 1e-4;

/// The stiffness of what is behind the boundary where all of a body is rigid, Pa.
const STIFF: f64 = 1e6;

/// Young's modulus over μ, nearly: from 2 to 3.
const YOUNG: f64 = 2.8;

/// Where a tool is to be, in metres from the frame's origin, and how often it was put elsewhere
/// without going there.
pub(in crate::physics) type Guided = (ToolPose, u64);

/// Refuses contact with `what` of bodies that cannot be stepped with it.
///
/// # Errors
/// [`Error::Input`].
pub(in crate::physics) fn check_contact(
    what: &str,
    network: &SpringNetwork,
    kind: SolverKind,
) -> Result<()> {
    if network.elements.is_empty() {
        return Err(Error::Input(format!(
            "contact with {what} is of finite elements, and the body is made of springs; choose --material neo-hookean (or corotated)"
        )));
    }
    match kind {
        SolverKind::Implicit | SolverKind::Bdf2 => Ok(()),
        _ => Err(Error::Input(format!(
            "{kind} knows no contact with {what}: take implicit or bdf2"
        ))),
    }
}

/// How many of the boundary `faces` of `network` go through others where its nodes stand at `x` (m).
///
/// # Errors
/// [`Error::Input`] for positions that are not those of its nodes.
#[cfg(feature = "rapier")]
pub(in crate::physics) fn faces_through(
    network: &SpringNetwork,
    faces: &[[u32; 3]],
    x: &[DVec3],
) -> Result<usize> {
    let settings = ConjugateGradients::default();
    let mut body = CpuBody::<f32>::new(network, SolverKind::Implicit, settings, None)?;
    body.set_state(x, &vec![DVec3::ZERO; x.len()])?;
    Ok(body.set_self_contact(&SelfContact::default(), faces, network))
}

impl<T: Real> CpuBody<T> {
    /// Adds a tool that presses on the boundary `faces` of `network`, which this body is, by the
    /// numbers of its nodes.
    pub fn add_tool(&mut self, tool: &Tool, faces: &[[u32; 3]], network: &SpringNetwork) {
        if contact(&self.terms).is_none() {
            let hull = self.hull(faces, network);
            let least = HOLDS * self.units.time;
            let term = Contact::new(hull, &self.plan, least);
            self.add_term(Box::new(term));
        }
        let at = ToolPlace {
            place: network.to_metres(tool.pose.place()) / self.units.length,
            turn: tool.pose.turn().normalize(),
        };
        let unit = network.length_unit / self.units.length;
        let Some(contact) = contact_mut(&mut self.terms) else {
            return;
        };
        let shape = tool.shape.scaled(unit);
        let gap = gap_of(tool, &shape, contact.hull.edge, unit);
        contact.tools.push(Pressing {
            shape,
            from: at,
            at,
            to: at,
            friction: tool.friction,
            gap,
            jumps: 0,
        });
        self.changed(Start::Restart);
    }

    /// Has the body feel itself from now on, as `wanted` says; its boundary is `faces` of `network`,
    /// which it is. How many of these go through others, or are of parts within others, as it is now.
    pub fn set_self_contact(
        &mut self,
        wanted: &SelfContact,
        faces: &[[u32; 3]],
        network: &SpringNetwork,
    ) -> usize {
        self.terms.retain(|term| term.touching().is_none());
        let hull = self.hull(faces, network);
        let gap = match wanted.gap {
            Some(gap) => gap * network.length_unit / self.units.length,
            None => BETWEEN * hull.edge,
        };
        let settings = [wanted.friction, gap.max(LEAST), HOLDS * self.units.time];
        let mut term = Touching::new(hull, &self.plan, settings);
        let through = term.surface.look((network, &self.place), &self.now.u);
        self.add_term(Box::new(term));
        through
    }

    /// Says where each tool is to be at the end of the next step.
    ///
    /// # Errors
    /// [`Error::Input`] for poses that are none, or another number of them.
    pub fn guide_tools(&mut self, tools: &[Guided]) -> Result<()> {
        let length = self.units.length;
        let place = |pose: &ToolPose| ToolPlace {
            place: pose.place() / length,
            turn: pose.turn().normalize(),
        };
        let places: Vec<ToolPlace> = tools
            .iter()
            .map(|(pose, _)| check_pose(pose).map(|()| place(pose)))
            .collect::<Result<_>>()?;
        let count = contact(&self.terms).map_or(0, |c| c.tools.len());
        if count != tools.len() {
            return Err(Error::Input(format!(
                "{} tools are guided on a body that has {count}",
                tools.len()
            )));
        }
        let Some(contact) = contact_mut(&mut self.terms) else {
            return Ok(());
        };
        let mut jumped = false;
        for (k, (place, (_, jumps))) in places.iter().zip(tools).enumerate() {
            if contact.tools[k].jumps == *jumps {
                contact.tools[k].to = *place;
                continue;
            }
            contact.tools[k].jumps = *jumps;
            contact.jump(k, *place);
            jumped = true;
        }
        self.changed(match jumped {
            true => Start::Restart,
            false => Start::Resume,
        });
        Ok(())
    }

    /// The force of the body on each tool, N, and its moment about the origin of the tool's shape,
    /// N·m.
    pub fn tool_forces(&self) -> Vec<[DVec3; 2]> {
        let at = At {
            u: &self.now.u,
            v: &self.now.v,
        };
        let units = [self.units.force(), self.units.energy()];
        let Some(contact) = contact(&self.terms) else {
            return Vec::new();
        };
        let local = contact.reactions(at);
        local
            .iter()
            .map(|[f, m]| [*f * units[0], *m * units[1]])
            .collect()
    }

    /// Moves what lies inside tools out of them before a first step.
    pub(super) fn clear_tools(&mut self) {
        let Some(contact) = contact_mut(&mut self.terms) else {
            return;
        };
        contact.begin(&self.now.u, (&self.free, &self.plan), (0.0, 0.0));
        let pushed = clear(contact, &self.now.u, &self.free);
        let rigid = self.newton.as_mut().map(|n| &mut n.rigid);
        super::newton_contact::put(pushed, &mut self.now.u, rigid);
    }

    /// Leaves tools where they went in a step that was sound, or puts them back where they were.
    pub(super) fn keep_tools(&mut self, sound: bool) {
        let own = touching(&self.terms).is_some_and(|own| !own.is_empty());
        let mut near = false;
        if let Some(contact) = contact_mut(&mut self.terms) {
            if !sound {
                contact.stage(0.0);
                return;
            }
            contact.rub(&self.now.u);
            contact.keep();
            near |= !contact.samples.is_empty();
        }
        match &mut self.implicit {
            Some(implicit) if own => implicit.forget_couplings(),
            Some(implicit) if near => implicit.forget_coarse(),
            _ => {}
        }
    }

    /// Where the tools are.
    pub(super) fn tool_places(&self) -> Vec<[f64; 7]> {
        let tools = contact(&self.terms).map_or(&[][..], |c| &c.tools);
        tools.iter().map(|t| t.from.numbers()).collect()
    }

    /// Puts the tools where [`CpuBody::tool_places`] found them.
    pub(super) fn resume_tools(&mut self, places: &[[f64; 7]]) {
        if let Some(contact) = contact_mut(&mut self.terms) {
            for (tool, numbers) in contact.tools.iter_mut().zip(places) {
                tool.from = ToolPlace::of_numbers(*numbers);
                tool.at = tool.from;
            }
        }
    }

    /// The boundary, each face with the stiffness of what is behind it.
    fn hull(&self, faces: &[[u32; 3]], network: &SpringNetwork) -> Hull {
        let faces: Vec<([u32; 3], f64)> = stiff_faces(faces, network, &self.units)
            .map(|(face, young)| (face.map(|v| self.place[v as usize]), young))
            .collect();
        let places = self.order.iter().map(|v| self.rest[*v as usize]);
        Hull::new(places.map(|x| x / self.units.length).collect(), &faces)
    }
}

/// The gap from which on `tool`, of a shape in local units, pushes on a body whose boundary has
/// edges of that mean length; `unit` is a file unit.
pub(in crate::physics) fn gap_of(tool: &Tool, shape: &Shape, edge: f64, unit: f64) -> f64 {
    let gap = match tool.gap {
        Some(gap) => gap * unit,
        None => (OF_SIZE * shape.size()).min(OF_EDGE * edge),
    };
    gap.max(LEAST)
}

/// `faces` of `network`, each with the Young's modulus of what is behind it, local units.
pub(in crate::physics) fn stiff_faces(
    faces: &[[u32; 3]],
    network: &SpringNetwork,
    units: &Units,
) -> impl Iterator<Item = ([u32; 3], f64)> {
    let mut around = vec![(0.0, 0.0); network.rest.len()];
    let (mut all, mut volume) = (0.0, 0.0);
    for e in &network.elements.tets {
        let young = YOUNG * e.lame[0];
        all += young * e.volume;
        volume += e.volume;
        for v in e.nodes {
            let (sum, count) = &mut around[v as usize];
            (*sum, *count) = (*sum + young, *count + 1.0);
        }
    }
    let mean = if volume > 0.0 { all / volume } else { STIFF };
    let pressure = units.force() / (units.length * units.length);
    faces.iter().map(move |face| {
        let of_node = |v: &u32| match around[*v as usize] {
            (sum, count) if count > 0.0 => sum / count,
            _ => mean,
        };
        let young = face.iter().map(of_node).sum::<f64>() / 3.0;
        (*face, young / pressure)
    })
}
