//! Analysis of triangle surfaces: components, open edges, orientation, area and volume.

use super::boundary::DisjointSets;
use super::{AnatomicalFrame, FieldDescription, TriMesh};
use crate::number_format::significant;
use glam::DVec3;
use std::collections::{HashMap, VecDeque};
use std::fmt;

/// Statistics and problems of a surface.
#[derive(Clone, Debug, serde::Serialize)]
pub struct SurfaceDescription {
    /// Vertices.
    pub vertices: usize,
    /// Triangles.
    pub triangles: usize,
    /// Connected components (through shared vertices).
    pub components: usize,
    /// Edges of one triangle only (rims of holes).
    pub open_edges: usize,
    /// Edges of more than two triangles.
    pub nonmanifold_edges: usize,
    /// Whether every edge belongs to two triangles.
    pub closed: bool,
    /// Whether neighbouring triangles are consistently oriented.
    pub consistently_oriented: bool,
    /// Vertices − edges + triangles: 2 for each sphere, 0 for each torus.
    pub euler_number: i64,
    /// Area, in the square of the file's unit.
    pub area: f64,
    /// Enclosed volume by the divergence theorem; meaningful if the surface is closed.
    pub volume: f64,
    /// Lower and upper corner of the bounds.
    pub bounds: [[f64; 3]; 2],
    /// Report on each field.
    pub fields: Vec<FieldDescription>,
    /// Frame of reference of the coordinates, if the file states one (read as RAS).
    pub frame: Option<AnatomicalFrame>,
    /// Notes of the reader.
    pub notes: Vec<String>,
}

/// Edges, smaller vertex first, with their triangles, and whether each traverses the edge from the
/// smaller to the larger vertex.
type Edges = HashMap<[u32; 2], Vec<(u32, bool)>>;

impl TriMesh {
    /// Returns the area-weighted normal of triangle `t`: half the cross product of its edges.
    pub fn area_vector(&self, t: usize) -> DVec3 {
        let [a, b, c] = self.corners(t);
        0.5 * (b - a).cross(c - a)
    }

    /// Returns the corners of triangle `t`.
    pub fn corners(&self, t: usize) -> [DVec3; 3] {
        self.triangles[t].map(|v| self.vertices[v as usize])
    }

    /// Returns the enclosed volume by the divergence theorem, positive if triangles face outward.
    pub fn volume(&self) -> f64 {
        let (low, high) = self.bounds();
        let middle = 0.5 * (low + high);
        let part = |t| {
            let [a, b, c] = self.corners(t).map(|p| p - middle);
            a.dot(b.cross(c)) / 6.0
        };
        (0..self.triangles.len()).map(part).sum()
    }

    /// Returns the axis-aligned bounding box: (lower corner, upper corner).
    pub fn bounds(&self) -> (DVec3, DVec3) {
        super::bounds(&self.vertices)
    }

    fn edges(&self) -> Edges {
        let mut edges = Edges::new();
        for (t, triangle) in self.triangles.iter().enumerate() {
            for i in 0..3 {
                let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
                let sides = edges.entry([a.min(b), a.max(b)]).or_default();
                sides.push((t as u32, a < b));
            }
        }
        edges
    }

    /// Returns the component of each triangle, numbered in the order of the triangles, and the
    /// number of components; triangles that share a vertex are connected.
    pub fn connected_components(&self) -> (Vec<u32>, usize) {
        let mut groups = DisjointSets::new(self.vertices.len());
        for [a, b, c] in &self.triangles {
            groups.union(*a, *b);
            groups.union(*b, *c);
        }
        let mut number = HashMap::new();
        let piece = self
            .triangles
            .iter()
            .map(|t| {
                let next = number.len() as u32;
                *number.entry(groups.find(t[0])).or_insert(next)
            })
            .collect();
        (piece, number.len())
    }

    /// Flips triangles so that neighbours are consistently oriented and each connected sheet
    /// encloses a positive volume. A consistent sheet inside another is left unchanged: it may be a
    /// cavity. Returns the number of flipped triangles.
    pub fn orient_consistently(&mut self) -> usize {
        let edges = self.edges();
        let mut across: Vec<Vec<(u32, bool)>> = vec![Vec::new(); self.triangles.len()];
        for sides in edges.values() {
            if let [(s, forward), (t, other)] = sides[..] {
                across[s as usize].push((t, forward == other));
                across[t as usize].push((s, forward == other));
            }
        }
        let mut flip: Vec<Option<bool>> = vec![None; self.triangles.len()];
        let mut turned = 0;
        for seed in 0..self.triangles.len() {
            if flip[seed].is_some() {
                continue;
            }
            flip[seed] = Some(false);
            let mut sheet = vec![seed];
            let mut queue = VecDeque::from([seed]);
            while let Some(t) = queue.pop_front() {
                let own = flip[t] == Some(true);
                for &(next, differs) in &across[t] {
                    if flip[next as usize].is_none() {
                        flip[next as usize] = Some(own ^ differs);
                        sheet.push(next as usize);
                        queue.push_back(next as usize);
                    }
                }
            }
            let flips = sheet.iter().filter(|t| flip[**t] == Some(true)).count();
            if flips > 0 {
                let origin = self.vertices[self.triangles[seed][0] as usize];
                let volume: f64 = sheet
                    .iter()
                    .map(|t| {
                        let [a, b, c] = self.corners(*t).map(|p| p - origin);
                        let part = a.dot(b.cross(c));
                        if flip[*t] == Some(true) { -part } else { part }
                    })
                    .sum();
                if volume < 0.0 {
                    sheet.iter().for_each(|t| flip[*t] = flip[*t].map(|f| !f));
                }
            }
            for t in sheet {
                if flip[t] == Some(true) {
                    self.flip_triangle(t);
                    turned += 1;
                }
            }
        }
        // A surface whose outermost sheets all face inward was written inside out.
        if turned == 0 && self.volume() < 0.0 {
            turned = self.triangles.len();
            (0..turned).for_each(|t| self.flip_triangle(t));
        }
        turned
    }
}

impl SurfaceDescription {
    /// Describes `surface`.
    pub fn new(surface: &TriMesh) -> SurfaceDescription {
        let edges = surface.edges();
        let count = |wanted: fn(usize) -> bool| edges.values().filter(|s| wanted(s.len())).count();
        let (open_edges, nonmanifold_edges) = (count(|n| n == 1), count(|n| n > 2));
        let agree = |sides: &Vec<(u32, bool)>| match sides[..] {
            [(_, a), (_, b)] => a != b,
            _ => true,
        };
        let (low, high) = surface.bounds();
        SurfaceDescription {
            vertices: surface.vertices.len(),
            triangles: surface.triangles.len(),
            components: surface.connected_components().1,
            open_edges,
            nonmanifold_edges,
            closed: open_edges == 0 && nonmanifold_edges == 0,
            consistently_oriented: edges.values().all(agree),
            euler_number: surface.vertices.len() as i64 - edges.len() as i64
                + surface.triangles.len() as i64,
            area: (0..surface.triangles.len())
                .map(|t| surface.area_vector(t).length())
                .sum(),
            volume: surface.volume(),
            bounds: [low.to_array(), high.to_array()],
            fields: surface.fields.iter().map(FieldDescription::new).collect(),
            frame: surface.frame,
            notes: surface.notes.clone(),
        }
    }
}

impl fmt::Display for SurfaceDescription {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = |n: usize, one: &str| format!("{n} {one}{}", if n == 1 { "" } else { "s" });
        writeln!(
            f,
            "surface       {} vertices, {} triangles, {}",
            self.vertices,
            self.triangles,
            plural(self.components, "piece")
        )?;
        match self.closed {
            true => writeln!(f, "closed        yes, Euler number {}", self.euler_number)?,
            false => writeln!(
                f,
                "closed        no: {}, {} shared by more than two triangles",
                plural(self.open_edges, "open edge"),
                plural(self.nonmanifold_edges, "edge")
            )?,
        }
        if !self.consistently_oriented {
            writeln!(
                f,
                "orientation   inconsistent between neighbouring triangles"
            )?;
        }
        writeln!(f, "area          {}", significant(self.area))?;
        writeln!(f, "volume        {}", significant(self.volume))?;
        let [low, high] = self.bounds;
        writeln!(f, "bounds        {low:?} to {high:?}")?;
        match self.frame {
            Some(frame) => writeln!(f, "frame         {frame}")?,
            None => writeln!(f, "frame         not stated")?,
        }
        for field in &self.fields {
            write!(
                f,
                "field         {:?} on {}, {}",
                field.name,
                field.location,
                plural(field.components, "component")
            )?;
            match (field.min, field.max) {
                (Some(min), Some(max)) => writeln!(f, ", {min} to {max}")?,
                _ => writeln!(f, ", no finite value")?,
            }
        }
        for note in &self.notes {
            writeln!(f, "note          {note}")?;
        }
        Ok(())
    }
}
