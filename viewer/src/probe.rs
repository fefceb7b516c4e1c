//! The values at a point of the body, in the status line.

use crate::app::App;
use crate::body_session::BodySession;
use glam::DVec3;
use palpate::mesh::Location;
use palpate::number_format::significant;
use palpate::physics::BodyField;
use palpate::render::Pick;

impl App {
    /// Shows the values at a pick.
    pub(crate) fn probe(&mut self, pick: &Pick) {
        let Some(show) = &self.show else { return };
        let (stage, mesh) = (show.stage(), show.stage().mesh());
        let field = stage.scalar_field();
        let at = |values: &[f64]| {
            let parts = pick.nodes.iter().zip(pick.weights);
            parts
                .map(|(v, w)| w * values.get(*v as usize).copied().unwrap_or(f64::NAN))
                .sum::<f64>()
        };
        let value = match &field.cells {
            Some(cells) => cells.get(pick.tet as usize).copied().unwrap_or(f64::NAN),
            None => at(&field.values),
        };
        let rest: DVec3 = pick
            .nodes
            .iter()
            .zip(pick.weights)
            .filter_map(|(v, w)| mesh.nodes.get(*v as usize).map(|p| w * *p))
            .sum();
        let label = mesh
            .region_field()
            .filter(|f| f.location == Location::Cell)
            .and_then(|f| f.values.get(pick.tet as usize))
            .map(|label| {
                let name = mesh.region_names.get(&(*label as i64));
                name.cloned().unwrap_or_else(|| format!("region {label}"))
            });
        let stress = stress_there(show, pick.tet);
        let p = pick.point;
        let mm = 1e3 * show.unit * (pick.point - rest).length();
        self.set_status(format!(
            "{}{} {}, displacement {} mm{stress}, at {}, {}, {}, tet {}",
            label.map_or(String::new(), |l| format!("{l}: ")),
            field.name,
            significant(value),
            significant(mm),
            significant(p.x),
            significant(p.y),
            significant(p.z),
            pick.tet
        ));
    }
}

/// Describes the stress in a tet; empty if the body has none.
fn stress_there(show: &BodySession, tet: u32) -> String {
    let Some(motion) = show.stage().motion() else {
        return String::new();
    };
    let of = |field: BodyField| {
        let all = field.per_tet(motion.simulator.as_ref()).ok()?;
        all.get(tet as usize).copied()
    };
    match (of(BodyField::VonMises), of(BodyField::Stress1)) {
        (Some(von_mises), Some(first)) => {
            let [von_mises, first] = [von_mises, first].map(pascals);
            format!(", stress {von_mises} (von Mises), {first} (largest principal)")
        }
        _ => String::new(),
    }
}

/// Formats a stress with a suitable unit.
fn pascals(stress: f64) -> String {
    let (unit, name) = match stress.abs() {
        s if s >= 1e6 => (1e6, "MPa"),
        s if s >= 1e3 => (1e3, "kPa"),
        _ => (1.0, "Pa"),
    };
    format!("{} {name}", significant(stress / unit))
}
