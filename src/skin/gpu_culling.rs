//! GPU culling of skin triangles before their vertices are computed: back-facing ones and ones
//! outside the view, by the normals and positions of their base nodes.
//!
//! One pass over the base triangles computes their orientation to the eye; one over the skin's
//! triangles compares it with their tilt at rest; two more compact the visible ones in order. The
//! draw is indirect: list and length stay on the GPU.

use super::base::SkinBase;
use super::draw::Skin;
use crate::Result;
use crate::gpu::{BitmaskPrefixSum, Gpu, Pass, Recorder, Texel};
use crate::mesh::unpack_normal;
use crate::render::View;
use crate::skin::basis::VertexBinding;
use crate::skin::culling::{CullBase, CullData};

mod gpu_data {
    use crate::render::View;
    crate::gpu_struct! {
        pub(super) struct CullBase {
            pub view: View,
            pub triangles: u32,
            pub _pad: [u32; 3],
        }
    }
    crate::gpu_struct! {
        pub(super) struct Cull {
            pub triangles: u32,
            pub closed: u32,
        }
    }
    crate::gpu_struct! {
        pub(super) struct CullList {
            pub runs: u32,
        }
    }
}

/// Triangles marked by one invocation.
const TRIANGLES_PER_WORD: usize = 32;

/// Passes that cull triangles, and the list of visible ones.
pub(super) struct Cull {
    base: Pass,
    base_count: u32,
    marks: Pass,
    triangles: u32,
    scan: Pass,
    list: Pass,
    fresh: wgpu::Buffer,
    /// Arguments of an indexed indirect draw, and a flag.
    pub(super) arguments: wgpu::Buffer,
    /// Three vertex indices for each visible triangle.
    pub(super) drawn: wgpu::Buffer,
}

impl Cull {
    /// Prepares culling of the triangles `corners` with vertices `bound` to `carrier`, listed in
    /// `indices`.
    pub fn new(
        gpu: &Gpu,
        carrier: &SkinBase,
        bound: &[VertexBinding],
        corners: &[[u32; 3]],
        indices: &wgpu::Buffer,
    ) -> Result<Cull> {
        let rest = carrier.rest_mesh();
        let normals: Vec<_> = rest.normals.iter().map(|n| unpack_normal(*n)).collect();
        let CullData { bases, triangles } = CullData::new(rest.nodes, &normals, bound, corners);
        let texels: Vec<[u32; 4]> = bases.iter().flat_map(base_texels).collect();
        let base = gpu.array_of("base triangles", Texel::U32x4, &texels)?;
        let texels: Vec<[u32; 4]> = triangles
            .iter()
            .map(|([a, b, c], tilt)| [*a, *b, *c, (*tilt as f32).to_bits()])
            .collect();
        let tilted = gpu.array_of("tilts", Texel::U32x4, &texels)?;
        let outlooks = gpu.array("outlooks", Texel::U32x4, bases.len())?;
        let runs = triangles.len().div_ceil(TRIANGLES_PER_WORD) as u32;
        let marks = gpu.buffer("marks", 8 * u64::from(runs))?;
        let fresh: [u32; 6] = [0, 1, 0, 0, 0, 0];
        let arguments = gpu.buffer_of("triangles drawn", &fresh)?;
        let drawn = gpu.buffer("corners drawn", 12 * triangles.len() as u64)?;
        let (base_count, count) = (bases.len() as u32, triangles.len() as u32);
        Ok(Cull {
            base: gpu
                .pass("skin/cull_base")
                .read(&carrier.positions)
                .read(&carrier.normals)
                .read(&base)
                .write(&outlooks)
                .write(&arguments)
                .params(&gpu_data::CullBase {
                    triangles: base_count,
                    ..bytemuck::Zeroable::zeroed()
                })
                .dispatch_items(base_count)?,
            marks: gpu
                .pass("skin/cull")
                .read(&tilted)
                .read(&outlooks)
                .read(&arguments)
                .write(&marks)
                .params(&gpu_data::Cull {
                    triangles: count,
                    closed: 0,
                })
                .dispatch_items(runs)?,
            scan: gpu
                .pass("gpu/bitmask_prefix_sum")
                .write(&marks)
                .write(&arguments)
                .params(&BitmaskPrefixSum { runs })
                .dispatch_workgroups([1, 1, 1])?,
            list: gpu
                .pass("skin/cull_list")
                .read(&marks)
                .read(indices)
                .write(&drawn)
                .params(&gpu_data::CullList { runs })
                .dispatch_items(runs)?,
            base_count,
            triangles: count,
            fresh: gpu.buffer_of("triangles drawn, fresh", &fresh)?,
            arguments,
            drawn,
        })
    }

    /// Records the culling for a `view`; the node normals must be up to date. `closed` enables
    /// back-face culling.
    pub fn record(&self, work: &mut Recorder, view: View, closed: bool) -> Result<()> {
        self.base.set_params(
            work,
            &gpu_data::CullBase {
                view,
                triangles: self.base_count,
                _pad: [0; 3],
            },
        )?;
        self.marks.set_params(
            work,
            &gpu_data::Cull {
                triangles: self.triangles,
                closed: u32::from(closed),
            },
        )?;
        let (fresh, used) = (&self.fresh, &self.arguments);
        work.encoder()
            .copy_buffer_to_buffer(fresh, 0, used, 0, fresh.size());
        for pass in [&self.base, &self.marks, &self.scan, &self.list] {
            pass.record(work);
        }
        Ok(())
    }

    /// Returns the triangles that were drawn last. Reads back.
    pub fn read_visible(&self, gpu: &Gpu) -> Result<Vec<[u32; 3]>> {
        let arguments: Vec<u32> = gpu.read_buffer(&self.arguments)?;
        let mut drawn: Vec<[u32; 3]> = gpu.read_buffer(&self.drawn)?;
        drawn.truncate(arguments.first().map_or(0, |n| *n as usize / 3));
        Ok(drawn)
    }
}

impl Skin {
    /// Enables culling of triangles before their vertices are computed: those outside the view, and
    /// for a closed skin the back-facing ones, determined by the normals and the strain of their
    /// base nodes and their tilt at rest. The image does not change. Translucent skins, and
    /// triangles bound to a node without a normal, are not culled. Worthwhile for large skins on
    /// coarser bodies; off by default.
    pub fn set_culling(&mut self, on: bool) {
        self.culling = on;
        self.cull = None;
    }

    /// Returns the triangles of [`Skin::rest`] that the last recording draws, without culled ones.
    /// Waits and reads back.
    ///
    /// # Errors
    /// An error if the device fails.
    pub fn visible_triangles(&self) -> Result<Vec<[u32; 3]>> {
        match &self.cull {
            Some(cull) => cull.read_visible(&self.gpu),
            None => Ok(self.shown_triangles()),
        }
    }

    pub(super) fn shown_triangles(&self) -> Vec<[u32; 3]> {
        let triangles = self.vertices.triangles.iter().zip(&self.visible);
        triangles.filter(|(_, s)| **s).map(|(t, _)| *t).collect()
    }

    /// Whether back faces are never visible.
    fn is_closed(&self) -> bool {
        let whole = self.corners as usize == 3 * self.vertices.triangles.len();
        // Clip planes open the surface and expose back faces.
        let uncut = self.inside.clips().next().is_none();
        whole && uncut && self.report.open_edges == 0 && self.report.nonmanifold_edges == 0
    }

    /// Records the culling, if it is enabled.
    pub(super) fn record_cull(
        &mut self,
        work: &mut Recorder,
        view: View,
        culls: bool,
    ) -> Result<()> {
        let cull = match (culls, self.cull.take()) {
            (false, _) => return Ok(()),
            (true, Some(cull)) => cull,
            (true, None) => {
                let shown = self.shown_triangles();
                let (carrier, bound) = (&self.carrier, &self.bound);
                Cull::new(&self.gpu, carrier, bound, &shown, &self.indices)?
            }
        };
        cull.record(work, view, self.is_closed())?;
        self.cull = Some(cull);
        Ok(())
    }
}

/// Packs a base triangle into texels.
fn base_texels(base: &CullBase) -> [[u32; 4]; 3] {
    let float = |x: f64| (x as f32).to_bits();
    let [a, b, c] = base.nodes;
    let [xx, xy, yy] = base.inverse.map(float);
    let [ab, bc, ca] = base.bend_stretch.map(float);
    let kinds = u32::from(base.smooth) | u32::from(base.flat) << 1;
    [
        [a, b, c, float(base.offset)],
        [xx, xy, yy, kinds],
        [ab, bc, ca, 0],
    ]
}
