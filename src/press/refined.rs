//! `palpate press --within`: the body is refined until the largest force is as exact as wanted.

use super::question::Question;
use super::{Press, PressOptions, session, setup};
use crate::accuracy::{
    MAX_RAISED_TETS, Refinable, Refined, Round, Solution, error_stage, first_mesh, of_order,
    recovery_errors, refine, with_size_field,
};
use crate::gpu::Gpu;
use crate::mesh::{ElementOrder, PIECES, TetMesh};
use crate::number_format::significant;
use crate::render::Image;
use crate::scene::{OrderChoice, Scene};
use crate::{Error, ProgressFn, Result};
use glam::DVec3;

/// The meshes on the way to a press.
#[derive(Clone, Debug)]
pub(super) struct Refinement {
    pub rounds: Vec<Round>,
    /// The largest depth, in file units.
    pub depth: f64,
    /// The force there in the last round, its error by the mesh (`None` after a single round), and its
    /// last change in that round, N.
    pub force: f64,
    pub error: Option<f64>,
    pub change: f64,
    /// Part of each element of the last mesh in the error in energy, J.
    errors: Vec<f64>,
    /// Why the force is not as exact as wanted, if so.
    pub missed: Option<String>,
}

impl Refinement {
    /// Returns the last mesh, and the meshes on the way, of a press to `depth` (file units) whose force
    /// had the last change `change`, N.
    pub fn new(refined: Refined, depth: f64, change: f64) -> (TetMesh, Refinement) {
        let Refined {
            mesh,
            solution,
            rounds,
            missed,
        } = refined;
        let refinement = Refinement {
            depth,
            force: solution.value,
            error: rounds.last().and_then(|round| round.error),
            change,
            errors: solution.errors,
            missed,
            rounds,
        };
        (mesh, refinement)
    }

    /// Returns the share of each tet of `mesh` in the error, %.
    pub fn tet_shares(&self, mesh: &TetMesh) -> Vec<f64> {
        let sum: f64 = self.errors.iter().sum();
        let pieces = match mesh.order {
            ElementOrder::Linear => 1,
            ElementOrder::Quadratic => PIECES,
        };
        let of_piece = 100.0 / (sum.max(f64::MIN_POSITIVE) * pieces as f64);
        let repeated = self.errors.iter();
        repeated
            .flat_map(|error| std::iter::repeat_n(of_piece * error, pieces))
            .collect()
    }
}

/// Called after each round with its numbers and a function that draws the pressed body.
type OnRound<'a> = &'a mut dyn FnMut(&Round, Draw<'_>) -> Result<()>;
type Draw<'a> = &'a mut dyn FnMut() -> Result<Image>;

impl Press {
    /// As [`Press::new`], on a mesh that is refined until the largest force is as exact as
    /// [`Scene::accuracy`] asks for. Place, direction, radius, depth and the part on the table are those
    /// of the first mesh. A press that misses the goal is returned all the same ([`Press::missed`]).
    ///
    /// Calls `on_round` after each mesh, with a function that returns a picture of the pressed body, cut
    /// through the press, whose colours are the sizes of its elements.
    ///
    /// # Errors
    /// As [`Press::new`] and a simulation step; [`Error::Input`] for a body whose error cannot be
    /// estimated.
    pub fn refined(
        gpu: &Gpu,
        (scene, wanted): (&Scene, &PressOptions),
        on_round: OnRound<'_>,
        progress: ProgressFn,
    ) -> Result<Press> {
        let (scene, mesh, may_raise) = first_mesh(scene)?;
        let (question, mesh) = Question::new(gpu, (&scene, mesh), wanted)?;
        let mut body = PressedBody {
            gpu,
            scene: &scene,
            question,
            may_raise,
            on_round,
            press: None,
            reached: 0.0,
            change: 0.0,
        };
        let refined = refine(&mut body, mesh, &scene.accuracy, progress)?;
        let (depth, change) = (body.question.depth, body.change);
        let (mesh, refinement) = Refinement::new(refined, depth, change);
        let mut press = Press::of_question(gpu, &question, &of_order(&scene, mesh.order), mesh)?;
        press.refinement = Some(refinement);
        Ok(press)
    }

    /// Draws the body at `positions`, cut through the press, with the sizes of its elements.
    fn picture_of_sizes(&mut self, positions: &[DVec3]) -> Result<Image> {
        let mut mesh = with_size_field(self.stage.mesh().clone())?;
        mesh.nodes = positions.to_vec();
        let mut stage = error_stage(mesh, &mut self.stage)?;
        let inside = self.sections_at_press();
        stage.set_sections(&inside)?;
        stage.image()
    }

    /// Returns the meshes on the way to this press, if its body was refined.
    pub fn rounds(&self) -> &[Round] {
        self.refinement.as_ref().map_or(&[], |own| &own.rounds)
    }

    /// Returns why the largest force is not as exact as wanted, and what it would take, if so.
    pub fn missed(&self) -> Option<&str> {
        self.refinement.as_ref()?.missed.as_deref()
    }
}

/// A body pressed to a depth, on one mesh after the other.
struct PressedBody<'a, 'b> {
    gpu: &'a Gpu,
    scene: &'a Scene,
    question: Question,
    may_raise: bool,
    on_round: OnRound<'b>,
    /// The last press, with its positions, and the last change of its force.
    press: Option<(Press, Vec<DVec3>)>,
    change: f64,
    /// Depth of the last state.
    reached: f64,
}

impl PressedBody<'_, '_> {
    fn new_press(&self, mesh: &TetMesh) -> Result<Press> {
        let scene = of_order(self.scene, mesh.order);
        Press::of_question(self.gpu, &self.question, &scene, mesh.clone())
    }

    /// Places the fingertip at the depth of the state before in a body with the positions `start`, until
    /// its force settles, then takes it to the largest depth. Returns the force, and why the fingertip
    /// stopped before, if so.
    fn settle_from(&mut self, press: &mut Press, start: &[DVec3]) -> Result<(f64, Option<String>)> {
        let motion = press.stage.motion_mut().ok_or_else(session::static_body)?;
        motion.set_sleep_allowed(false);
        let (before, depth) = (self.reached, self.question.depth);
        let session = &mut press.session;
        let [mut force, change] = session.settle_at(motion, start, before, &mut || Ok(()))?;
        session.set_depth(before);
        if before < depth {
            let Some(sample) = session.press_to(motion, depth, "load")? else {
                return Ok((force, Some(inversion_at(press.current_depth(), press))));
            };
            force = sample.force_n;
        }
        self.change = change;
        Ok((force, None))
    }

    /// Presses on a body at rest, step by step. Returns the force, and why the fingertip stopped before
    /// the largest depth, if so.
    fn press_from_rest(&self, press: &mut Press) -> Result<(f64, Option<String>)> {
        while !press.at_max_depth() {
            press.advance()?;
            if press.inversion_depth().is_some() {
                break;
            }
        }
        let force = press.samples().last().map_or(f64::NAN, |s| s.force_n);
        let stopped = press.inversion_depth();
        Ok((
            force,
            stopped.map(|_| inversion_at(press.current_depth(), press)),
        ))
    }
}

/// Says that tets would be inverted deeper than `depth`, in file units.
fn inversion_at(depth: f64, press: &Press) -> String {
    format!(
        "tets would be inverted deeper than {} mm; press less deep (--depth), or with a larger --radius",
        significant(1e3 * press.session.unit() * depth)
    )
}

impl Refinable for PressedBody<'_, '_> {
    fn solve(&mut self, mesh: &TetMesh, start: Option<&[DVec3]>) -> Result<Solution> {
        let mut press = self.new_press(mesh)?;
        // Bodies without an estimate are refused before any work.
        press.rest_body()?;
        let (value, stopped) = match start {
            None => self.press_from_rest(&mut press)?,
            Some(start) => match self.settle_from(&mut press, start) {
                Err(Error::Solver { .. }) => {
                    press = self.new_press(mesh)?;
                    self.press_from_rest(&mut press)?
                }
                settled => settled?,
            },
        };
        self.reached = press.current_depth();
        if stopped.is_none() {
            // A press to a force becomes one to the depth of the first mesh.
            self.question.depth = self.reached;
            self.question.force = None;
        }
        let motion = press.stage.motion().ok_or_else(session::static_body)?;
        let positions = motion.positions()?;
        let errors = recovery_errors(motion, &positions)?;
        self.press = Some((press, positions.clone()));
        Ok(Solution {
            value,
            positions,
            errors,
            stopped,
        })
    }

    fn may_raise_order(&self, mesh: &TetMesh) -> bool {
        let mut scene = setup::with_default_order(self.scene);
        scene.material.order = Some(OrderChoice::Auto);
        self.may_raise && scene.supports_order_2(mesh, MAX_RAISED_TETS)
    }

    fn after(&mut self, round: &Round, _: &TetMesh) -> Result<()> {
        match &mut self.press {
            Some((press, positions)) => {
                (self.on_round)(round, &mut || press.picture_of_sizes(positions))
            }
            None => Ok(()),
        }
    }
}
