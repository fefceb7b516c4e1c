//! Pictures a second of skins: section 3.4 of Mosegaard & Sørensen (2005).

use super::{Case, Context, Row};
use crate::Result;
use crate::gpu::Gpu;
use crate::mesh::{LocalFrame, TriMesh};
use crate::mesher::{ClosedSurface, SurfaceDomain};
use crate::physics::grid::{GridModel, GridShape};
use crate::physics::{GridBody, Material};
use crate::render::{Camera, SurfaceTarget, local_positions};
use crate::skin::{Mapping, Skin, SkinBase};
use glam::{DMat3, DVec3};
use std::cell::RefCell;
use std::rc::Rc;

pub(super) const ABOUT: &str = "Pictures of 512 × 512 pixels of a detailed surface on a grid \
    body, or on nodes placed by hand: alone, with culling, and with the steps of the body before \
    each picture. The paper's values are those of a GeForce 6800 Ultra, with normal mapping.";

const PIXELS: u32 = 512;
/// Steps of the body before a picture.
const STEPS: u32 = 15;

/// A surface and what carries it.
#[derive(Clone, Copy)]
struct Subject {
    /// Rings of the surface, and vertices around each.
    rings: u32,
    around: u32,
    /// Particles of the grid body; nodes placed by hand without.
    particles: Option<usize>,
    /// Whether it is the heart that the paper measured.
    heart: bool,
}

const SUBJECTS: [Subject; 3] = [
    Subject {
        rings: 126,
        around: 200,
        particles: Some(20_000),
        heart: true,
    },
    Subject {
        rings: 51,
        around: 100,
        particles: None,
        heart: false,
    },
    Subject {
        rings: 451,
        around: 700,
        particles: Some(42_745),
        heart: false,
    },
];

/// How pictures are measured.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Alone,
    Culled,
    WithSteps,
}

pub(super) fn cases(quick: bool) -> Vec<Case> {
    let subjects = if quick { &SUBJECTS[..1] } else { &SUBJECTS[..] };
    let mut all = Vec::new();
    for &subject in subjects {
        // Built once for all rows of the subject, which takes longest.
        let built = Rc::new(RefCell::new(None));
        for mapping in [Mapping::OneToOne, Mapping::Constant, Mapping::Interpolated] {
            for kind in [Kind::Alone, Kind::Culled, Kind::WithSteps] {
                if kind == Kind::WithSteps && subject.particles.is_none()
                    || kind == Kind::Culled && quick
                {
                    continue;
                }
                all.push(case(subject, Rc::clone(&built), mapping, kind));
            }
        }
    }
    all
}

/// A surface, its base, and the body if there is one.
type Built = (TriMesh, SkinBase, Option<GridBody>);

fn case(subject: Subject, built: Rc<RefCell<Option<Built>>>, mapping: Mapping, kind: Kind) -> Case {
    let what = match kind {
        Kind::Alone => mapping.to_string(),
        Kind::Culled => format!("{mapping}, culled"),
        Kind::WithSteps => format!("{mapping}, {STEPS} steps"),
    };
    let paper = match (mapping, kind) {
        (Mapping::Constant, Kind::Alone) => Some(190.0),
        (Mapping::Interpolated, Kind::Alone) => Some(150.0),
        (Mapping::Interpolated, Kind::WithSteps) => Some(25.0),
        _ => None,
    };
    let faces = 2 * subject.around * (subject.rings - 1);
    let row = Row::new(what, "gpu", "pictures/s")
        .size(faces as usize, "faces")
        .paper(paper.filter(|_| subject.heart));
    Case::new(row, move |context, row| {
        let mut kept = built.borrow_mut();
        let made = match kept.take() {
            Some(made) => made,
            None => subject.build(context.gpu)?,
        };
        measure(context, row, kept.insert(made), mapping, kind)
    })
}

/// Returns a ball of radius `r` of 2 `around` (`rings` − 1) triangles, with bumps of relative
/// height `hills`.
pub(super) fn ball(rings: u32, around: u32, r: f64, hills: f64) -> TriMesh {
    let at = |ring: u32, k: u32| 1 + (ring - 1) * around + k % around;
    let last = at(rings, 0);
    let place = |polar: f64, turn: f64| {
        let p = DVec3::new(
            polar.sin() * turn.cos(),
            polar.sin() * turn.sin(),
            polar.cos(),
        );
        p * r * (1.0 + hills * (9.0 * p.x).sin() * (7.0 * p.y + p.z).cos())
    };
    let (pi, mut surface) = (std::f64::consts::PI, TriMesh::default());
    surface.vertices.push(place(0.0, 0.0));
    for ring in 1..rings {
        let polar = pi * f64::from(ring) / f64::from(rings);
        let turn = |k: u32| 2.0 * pi * f64::from(k) / f64::from(around);
        let ring = (0..around).map(|k| place(polar, turn(k)));
        surface.vertices.extend(ring);
    }
    surface.vertices.push(place(pi, 0.0));
    for k in 0..around {
        let cap = [last, at(rings - 1, k + 1), at(rings - 1, k)];
        surface.triangles.extend([[0, at(1, k), at(1, k + 1)], cap]);
        for ring in 1..rings - 1 {
            let [a, b] = [at(ring, k), at(ring + 1, k)];
            let [c, d] = [at(ring + 1, k + 1), at(ring, k + 1)];
            surface.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    surface
}

impl Subject {
    /// Returns the surface and its base, with the body if there is one.
    fn build(&self, gpu: &Gpu) -> Result<Built> {
        let Some(particles) = self.particles else {
            let nodes = ball(5, 4, 1.0, 0.0);
            let (low, high) = crate::mesh::bounds(&nodes.vertices);
            let frame = LocalFrame::from_bounds(low, high);
            let positions = local_positions(gpu, &frame, &nodes.vertices)?;
            let (rest, triangles) = (&nodes.vertices, &nodes.triangles);
            let base = SkinBase::with_area_normals(gpu, &positions, frame, rest, triangles)?;
            return Ok((ball(self.rings, self.around, 1.05, 0.05), base, None));
        };
        let surface = ball(self.rings, self.around, 0.05, 0.06);
        let inside = SurfaceDomain::new(vec![ClosedSurface::new(&surface)?])?;
        let shape = GridShape::from_domain_with_count(&inside, particles, DMat3::IDENTITY)?;
        let mut body = GridBody::new(gpu, GridModel::new(shape, &Material::from_young(1e4))?)?;
        let base = SkinBase::from_grid(&mut body)?;
        Ok((surface, base, Some(body)))
    }
}

fn measure(
    context: &Context,
    row: Row,
    (surface, base, body): &mut Built,
    mapping: Mapping,
    kind: Kind,
) -> Result<Row> {
    let gpu = context.gpu;
    let (low, high) = crate::mesh::bounds(&surface.vertices);
    let (middle, size) = (0.5 * (low + high), (high - low).length());
    let camera = Camera::perspective(middle - 1.6 * size * DVec3::Y, middle, DVec3::Z, 35.0);
    let mut skin = Skin::new(gpu, surface, base, mapping)?;
    let view = |format| {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
        gpu.target("measured picture", [PIXELS; 2], format, usage)
    };
    let colour = view(wgpu::TextureFormat::Rgba8Unorm)?;
    let depth = view(wgpu::TextureFormat::Depth32Float)?;
    skin.set_culling(kind == Kind::Culled);
    let spread = context.timing().measure(|| {
        if let Some(body) = body.as_mut().filter(|_| kind == Kind::WithSteps) {
            let dt = 0.5 * body.model().conservative_step();
            body.run(STEPS, dt)?;
        }
        let mut work = gpu.start_recording();
        let target = SurfaceTarget {
            colour: &colour,
            depth: &depth,
            background: Some([0.0; 4]),
        };
        skin.record(&mut work, &camera, &target)?;
        work.submit()?;
        gpu.wait()
    })?;
    let carrier = match body {
        Some(body) => format!("{} particles", body.model().shape.count()),
        None => "18 nodes placed by hand".into(),
    };
    let note = match kind {
        Kind::Culled => {
            let seen = skin.visible_triangles()?.len() as f64;
            let culled = 100.0 * (1.0 - seen / surface.triangles.len() as f64);
            format!("{carrier}, {culled:.0} % culled")
        }
        Kind::Alone | Kind::WithSteps => carrier,
    };
    Ok(row.spread(spread.per_second(1.0)).note(note))
}
