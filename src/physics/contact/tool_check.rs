//! Checks whether the contact of a tool with a deformed body is valid.

use super::{Shape, Tool, ToolPose};
use crate::mesh::{TetMesh, Topology};
use crate::number_format::significant;
use glam::DVec3;
use std::fmt;

/// Depth of a node inside a tool, relative to the tool's size, above which it is a problem; smaller
/// ones are within the tolerance of a penalty contact.
const PENETRATION_TOLERANCE: f64 = 0.1;

/// Tolerance of a point on a face of a tet, relative to the tet's height above the face.
const FACE_TOLERANCE: f64 = 1e-9;

/// Why the force of a body on a tool is not valid; lengths are in file units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ToolProblem {
    /// The tool's centre is inside a tet.
    InsideBody,
    /// Free boundary nodes are inside the tool.
    Penetration(super::Penetration),
    /// The tool touches faces that are larger than itself.
    CoarseFaces {
        /// Radius of the tool.
        radius: f64,
        /// Mean edge length of the faces.
        edge: f64,
    },
}

impl fmt::Display for ToolProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ToolProblem::InsideBody => f.write_str(
                "is inside the body, where it does not press on its surface; its force is not valid: start it outside, or use a larger tool or a finer mesh",
            ),
            ToolProblem::Penetration(found) => write!(
                f,
                "contains {} boundary nodes, up to {} deep; its force is not valid: use shorter steps (dt) or a slower path",
                found.nodes,
                significant(found.depth)
            ),
            ToolProblem::CoarseFaces { radius, edge } => write!(
                f,
                "of radius {} is smaller than the faces that it touches, whose edges measure {}; its force is not reliable: use a finer mesh",
                significant(*radius),
                significant(*edge)
            ),
        }
    }
}

impl Tool {
    /// Returns why the contact of `mesh`, deformed to the node positions `x` in file units, with the
    /// tool at `pose` is not valid, if it is not. `fixed` marks pinned nodes, which no tool moves;
    /// `touches` is whether the tool exerts a force.
    pub(crate) fn contact_problem(
        &self,
        pose: &ToolPose,
        (mesh, topology): (&TetMesh, &Topology),
        (x, fixed): (&[DVec3], &[bool]),
        touches: bool,
    ) -> Option<ToolProblem> {
        let centre = pose.position();
        let solid = self.shape.distance(DVec3::ZERO) < 0.0;
        let at = |v: u32| x[v as usize];
        if solid && mesh.tets.iter().any(|t| contains(t.map(at), centre)) {
            return Some(ToolProblem::InsideBody);
        }
        let boundary = topology.all_boundary_nodes(mesh);
        let free = boundary.into_iter().filter(|v| !fixed[*v as usize]);
        let found = self.penetration(pose, free.map(at));
        let size = self.shape.feature_size();
        if size.is_finite() && found.depth > PENETRATION_TOLERANCE * size {
            return Some(ToolProblem::Penetration(found));
        }
        let (Shape::Sphere { radius } | Shape::Capsule { radius, .. }) = self.shape else {
            return None;
        };
        let edge = self.mean_edge_beneath(pose, (mesh, topology), x)?;
        (touches && radius < edge).then_some(ToolProblem::CoarseFaces { radius, edge })
    }

    /// Returns the mean edge length of the boundary faces with a node nearer to the tool than half
    /// its thickness, if there are any.
    fn mean_edge_beneath(
        &self,
        pose: &ToolPose,
        (mesh, topology): (&TetMesh, &Topology),
        x: &[DVec3],
    ) -> Option<f64> {
        let back = pose.rotation().inverse();
        let near = |p: &DVec3| {
            self.shape.distance(back * (*p - pose.position())) < self.shape.half_thickness()
        };
        let (mut sum, mut count) = (0.0, 0.0);
        for face in &topology.boundary {
            let [a, b, c] = topology.boundary_nodes(mesh, *face).map(|v| x[v as usize]);
            if [a, b, c].iter().any(near) {
                sum += (a.distance(b) + b.distance(c) + c.distance(a)) / 3.0;
                count += 1.0;
            }
        }
        (count > 0.0).then(|| sum / count)
    }
}

/// Whether `p` is in a tet that is not inverted, or on its faces.
fn contains([a, b, c, d]: [DVec3; 4], p: DVec3) -> bool {
    let volume = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| (b - a).cross(c - a).dot(d - a);
    let least = -FACE_TOLERANCE * volume(a, b, c, d);
    least < 0.0
        && volume(p, b, c, d) >= least
        && volume(a, p, c, d) >= least
        && volume(a, b, p, d) >= least
        && volume(a, b, c, p) >= least
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::generate::{Split, box_mesh};
    use glam::DQuat;

    #[test]
    fn each_problem_of_a_contact_is_found() {
        let mesh = box_mesh([4, 4, 4], DVec3::ONE, Split::Five).unwrap();
        let topology = Topology::new(&mesh);
        let free = vec![false; mesh.nodes.len()];
        let find = |radius: f64, z: f64, touches: bool, fixed: &[bool]| {
            let at = DVec3::new(0.3, 0.3, z);
            let tool = Tool {
                shape: Shape::Sphere { radius },
                pose: ToolPose::new(at, DQuat::IDENTITY),
                friction: 0.0,
                gap: None,
            };
            let body = (&mesh, &topology);
            tool.contact_problem(&tool.pose, body, (&mesh.nodes, fixed), touches)
        };
        assert_eq!(find(0.05, 0.9, false, &free), Some(ToolProblem::InsideBody));
        assert!(matches!(
            find(0.4, 1.1, true, &free),
            Some(ToolProblem::Penetration(found)) if found.nodes > 0
        ));
        let all = vec![true; mesh.nodes.len()];
        assert_eq!(find(0.4, 1.1, true, &all), None);
        let coarse =
            |found| matches!(found, Some(ToolProblem::CoarseFaces { edge, .. }) if edge > 0.2);
        assert!(coarse(find(0.09, 1.09, true, &free)));
        assert_eq!(find(0.09, 1.09, false, &free), None);
        assert_eq!(find(0.4, 1.401, true, &free), None);
        assert_eq!(find(0.05, 3.0, true, &free), None);
    }
}
