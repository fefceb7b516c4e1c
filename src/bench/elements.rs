//! Milliseconds a step of finite elements.

use super::{Case, Context, Row, hold_one_end};
use crate::Result;
use crate::generate;
use crate::physics::{Engine, EngineChoice, Material, MaterialModel, SolverKind};
use glam::DVec3;

pub(super) const ABOUT: &str = "A bar of 0.8 × 0.2 × 0.2 m, 1 MPa, ν = 0.3, clamped at one end \
    and released under gravity. Implicit steps of 0.01 s with linear solves to 10⁻³; explicit ones \
    at half the largest stable step.";

const SIZE: DVec3 = DVec3::new(0.8, 0.2, 0.2);
const STEP: f64 = 0.01;
/// Steps before the timed ones, in which the body hardly deforms.
const FIRST_STEPS: u32 = 3;

pub(super) fn cases(quick: bool) -> Vec<Case> {
    let (sizes, models): (&[usize], &[MaterialModel]) = match quick {
        true => (&[4_320], &[MaterialModel::NeoHookean]),
        false => (
            &[4_320, 34_560, 155_520],
            &[MaterialModel::NeoHookean, MaterialModel::Corotated],
        ),
    };
    let kinds = [
        (SolverKind::Implicit, Engine::Gpu),
        (SolverKind::Implicit, Engine::Cpu),
        (SolverKind::Symplectic, Engine::Gpu),
        (SolverKind::Symplectic, Engine::Cpu),
        (SolverKind::Bdf2, Engine::Cpu),
    ];
    let mut all = Vec::new();
    for &tets in sizes {
        for &model in models {
            for (kind, engine) in kinds {
                let what = format!("{model}, {kind}");
                let row = Row::new(what, &engine.to_string(), "ms").size(tets, "tets");
                all.push(Case::new(row, move |context, row| {
                    step(context, row, tets, model, (kind, engine))
                }));
            }
        }
    }
    all
}

fn step(
    context: &Context,
    row: Row,
    tets: usize,
    model: MaterialModel,
    (kind, engine): (SolverKind, Engine),
) -> Result<Row> {
    let mesh = generate::bar_of_about(tets, SIZE)?;
    let tets = mesh.tets.len();
    let material = Material {
        model,
        poisson: 0.3,
        ..Material::from_young(1e6)
    };
    let choice = EngineChoice::Exactly(engine);
    let mut body = choice.build_tets(context.gpu, mesh, &material, kind)?;
    hold_one_end(body.as_mut())?;
    let limit = body.largest_stable_step();
    let (h, steps) = limit.map_or((STEP, 1), |limit| (0.5 * limit, 8));
    body.run(FIRST_STEPS, h)?;
    let spread = context
        .timing()
        .measure(|| body.run(steps, h).map(drop))?
        .per_item(f64::from(steps));
    let row = row.size(tets, "tets").spread(spread);
    let iterations = body.iterations()?;
    Ok(match kind.is_implicit() && !iterations.is_empty() {
        true => {
            let sum: u32 = iterations.iter().sum();
            let mean = f64::from(sum) / iterations.len() as f64;
            row.note(format!("{mean:.1} iterations a step"))
        }
        false => row,
    })
}
