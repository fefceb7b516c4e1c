//! Choice of the clamped end of a body without supports: an end with a sufficient cross-section.

use glam::DVec3;

/// Minimum mean cross-section of a clamped end, over that of the body.
const MIN_RELATIVE_SECTION: f64 = 0.35;
/// Fractions of an axis that are tried, smallest first.
const SLAB_FRACTIONS: [f64; 5] = [0.05, 0.1, 0.15, 0.2, 0.25];
/// Axes along which the body is shorter than this fraction of its longest extent are tried last.
const MIN_AXIS_RATIO: f64 = 0.5;
/// Minimum number of clamped nodes.
const MIN_CLAMPED_NODES: usize = 3;

/// A clamped end of a body.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ClampedEnd {
    /// Its nodes.
    pub nodes: Vec<u32>,
    /// Its normal axis: 0, 1 or 2.
    pub axis: usize,
    /// Whether it is the upper end of that axis.
    pub upper: bool,
    /// Its fraction of the bounds along the axis.
    pub axis_fraction: f64,
    /// Its mean cross-section over the body's.
    pub relative_section: f64,
}

impl ClampedEnd {
    /// Chooses the best end to clamp for nodes at `points` with these masses: a flat end of the
    /// longest axis (the lower of two equal ones), else of the next axis, else the lowest part
    /// along `down`, thick enough not to be a tip. Only the nodes `among` are considered.
    pub fn from_points(points: &[DVec3], masses: &[f64], among: &[u32], down: DVec3) -> ClampedEnd {
        let places: Vec<DVec3> = among.iter().map(|v| points[*v as usize]).collect();
        let (low, high) = crate::mesh::bounds(&places);
        let extent = high - low;
        let total: f64 = among.iter().map(|v| masses[*v as usize]).sum();
        let slab = |axis: usize, upper: bool, share: f64| {
            let limit = share * extent[axis];
            let within = |v: &&u32| {
                let x = points[**v as usize][axis];
                match upper {
                    false => x <= low[axis] + limit,
                    true => x >= high[axis] - limit,
                }
            };
            let nodes: Vec<u32> = among.iter().filter(within).copied().collect();
            let mass: f64 = nodes.iter().map(|v| masses[*v as usize]).sum();
            let firmness = mass / (share * total).max(f64::MIN_POSITIVE);
            ClampedEnd {
                relative_section: if nodes.len() < MIN_CLAMPED_NODES {
                    0.0
                } else {
                    firmness
                },
                nodes,
                axis,
                upper,
                axis_fraction: share,
            }
        };
        let mut axes = [0, 1, 2];
        // The sort is stable: x comes first among equals, as in `max_position`.
        axes.sort_by(|a, b| extent[*b].total_cmp(&extent[*a]));
        let longest = extent.max_element();
        // Along an axis on which the body stands or hangs, only its lower end can be clamped.
        let stands = |axis: usize| down.normalize_or_zero()[axis].abs() > 0.9;
        let best_of = |axis: usize, share: f64| {
            let ends = [slab(axis, false, share), slab(axis, true, share)];
            let [lower, upper] = ends;
            match stands(axis) {
                true if down[axis] > 0.0 => upper,
                true => lower,
                false if upper.relative_section > 1.5 * lower.relative_section => upper,
                false => lower,
            }
        };
        let flat = axes
            .iter()
            .filter(|a| extent[**a] >= MIN_AXIS_RATIO * longest)
            .map(|axis| best_of(*axis, SLAB_FRACTIONS[0]))
            .find(|end| end.relative_section >= MIN_RELATIVE_SECTION);
        if let Some(flat) = flat {
            return flat;
        }
        axes.sort_by_key(|axis| !stands(*axis));
        let candidates = SLAB_FRACTIONS
            .iter()
            .flat_map(|s| axes.map(|axis| best_of(axis, *s)));
        let mut best: Option<ClampedEnd> = None;
        for end in candidates {
            if end.relative_section >= MIN_RELATIVE_SECTION {
                return end;
            }
            if best
                .as_ref()
                .is_none_or(|b| end.relative_section > b.relative_section)
            {
                best = Some(end);
            }
        }
        match best {
            Some(best) if !best.nodes.is_empty() => best,
            _ => slab(axes[0], false, 1.0),
        }
    }

    /// As [`ClampedEnd::from_points`] for the largest component connected by `ties` between nodes;
    /// adds nodes at the ends of the other components, so that none falls. Also returns the number
    /// of components.
    pub fn of_largest_component(
        points: &[DVec3],
        masses: &[f64],
        ties: impl Iterator<Item = [u32; 2]>,
        down: DVec3,
    ) -> (ClampedEnd, usize) {
        let mut pieces = connected_components(points.len(), ties);
        let mass = |piece: &Vec<u32>| piece.iter().map(|v| masses[*v as usize]).sum::<f64>();
        pieces.retain(|piece| mass(piece) > 0.0);
        pieces.sort_by(|a, b| mass(b).total_cmp(&mass(a)));
        let mut ends = pieces
            .iter()
            .map(|piece| ClampedEnd::from_points(points, masses, piece, down));
        let Some(mut held) = ends.next() else {
            let all: Vec<u32> = (0..points.len() as u32).collect();
            return (ClampedEnd::from_points(points, masses, &all, down), 1);
        };
        ends.for_each(|end| held.nodes.extend(end.nodes));
        held.nodes.sort_unstable();
        (held, pieces.len())
    }

    /// The direction of a load across the end that bends the body most: −z, or −y if the end is
    /// normal to z.
    pub fn load_direction(&self) -> DVec3 {
        match self.axis {
            2 => DVec3::NEG_Y,
            _ => DVec3::NEG_Z,
        }
    }
}

impl std::fmt::Display for ClampedEnd {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "the {} nodes in the {} {:.0} % of the {} extent",
            self.nodes.len(),
            if self.upper { "highest" } else { "lowest" },
            100.0 * self.axis_fraction,
            ["x", "y", "z"][self.axis.min(2)]
        )
    }
}

/// The connected components of `count` nodes connected by pairs.
fn connected_components(count: usize, ties: impl Iterator<Item = [u32; 2]>) -> Vec<Vec<u32>> {
    let mut parent: Vec<u32> = (0..count as u32).collect();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for [a, b] in ties {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        parent[a.max(b) as usize] = a.min(b);
    }
    let mut pieces: std::collections::BTreeMap<u32, Vec<u32>> = std::collections::BTreeMap::new();
    for v in 0..count as u32 {
        pieces.entry(root(&mut parent, v)).or_default().push(v);
    }
    pieces.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn end_of(points: &[DVec3]) -> ClampedEnd {
        let masses = vec![1.0; points.len()];
        let all: Vec<u32> = (0..points.len() as u32).collect();
        ClampedEnd::from_points(points, &masses, &all, DVec3::NEG_Z)
    }

    /// The points of a grid that lie inside.
    fn points(size: [usize; 3], inside: impl Fn(DVec3) -> bool) -> Vec<DVec3> {
        let [nx, ny, nz] = size;
        let all = (0..nx * ny * nz)
            .map(|i| DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64));
        all.filter(|p| inside(*p)).collect()
    }

    #[test]
    fn bar_is_clamped_at_lower_end_of_longest_axis() {
        let end = end_of(&points([41, 9, 9], |_| true));
        assert_eq!((end.axis, end.upper, end.axis_fraction), (0, false, 0.05));
    }

    #[test]
    fn cone_is_clamped_at_base_in_any_orientation() {
        for upper in [false, true] {
            let cone = points([81, 31, 31], |p| {
                let along = if upper { p.x } else { 80.0 - p.x };
                (p.y - 15.0).hypot(p.z - 15.0) <= 15.0 * along / 80.0
            });
            let end = end_of(&cone);
            assert_eq!((end.axis, end.upper), (0, upper));
            assert!(end.relative_section > 1.0);
        }
    }

    #[test]
    fn ball_is_clamped_at_lowest_part_not_at_tip() {
        let ball = points([31, 31, 31], |p| p.distance(DVec3::splat(15.0)) <= 15.0);
        let end = end_of(&ball);
        assert_eq!((end.axis, end.upper), (2, false));
        assert!(
            end.axis_fraction > 0.05 && end.relative_section >= MIN_RELATIVE_SECTION,
            "{end:?}"
        );
    }

    #[test]
    fn spindle_on_legs_is_clamped_at_legs() {
        let beast = points([121, 21, 31], |p| {
            let x = (p.x - 60.0) / 60.0;
            let body = (p.y - 10.0).hypot(p.z - 20.0) <= 9.0 * (1.0 - x * x);
            let leg = (30.0..90.0).contains(&p.x) && p.x % 30.0 < 10.0 && p.z < 15.0;
            body || leg
        });
        let end = end_of(&beast);
        assert_eq!((end.axis, end.upper), (2, false), "{end:?}");
    }

    #[test]
    fn every_component_is_clamped() {
        let one = points([21, 5, 5], |_| true);
        let count = one.len() as u32;
        let two: Vec<DVec3> = one
            .iter()
            .copied()
            .chain(one.iter().map(|p| *p + 50.0 * DVec3::Y))
            .collect();
        let ties = (0..2 * count - 1)
            .filter(|i| *i != count - 1)
            .map(|i| [i, i + 1]);
        let masses = vec![1.0; two.len()];
        let (held, pieces) = ClampedEnd::of_largest_component(&two, &masses, ties, DVec3::NEG_Z);
        assert_eq!(pieces, 2);
        assert!(held.nodes.iter().any(|v| *v < count) && held.nodes.iter().any(|v| *v >= count));
    }
}
