//! GPU computation of the light transmittance at each node, updated when the nodes move or the
//! appearance changes.

use super::Raycaster;
use crate::Result;
use crate::gpu::{Array, Pass, Recorder, Texel};
use crate::render::light::GRADIENT_HALF_SATURATION;
use crate::render::shadows::{LightDirections, SURFACE_OFFSET, ShadowResolution};

mod gpu_data {
    crate::gpu_struct! {
        /// Parameters of `shaders/render/shadow_bounds.wgsl`.
        pub struct Bounds {
            pub nodes: u32,
        }
    }
    crate::gpu_struct! {
        /// Parameters of `shaders/render/shadow_fill.wgsl`.
        pub struct Fill {
            pub tets: u32,
            pub cells: u32,
            pub points: u32,
        }
    }
    crate::gpu_struct! {
        /// Parameters of `shaders/render/shadow_march.wgsl`.
        pub struct March {
            pub nodes: u32,
            pub cells: u32,
            pub directions: u32,
            pub steps: u32,
            pub opacity: f32,
            pub normalisation: f32,
            pub strength: f32,
            pub surface_offset: f32,
            pub gradient_half_saturation: f32,
        }
    }
}

/// Shadow passes and their result.
pub(super) struct Shadows {
    /// Gradients at the nodes (xyz) and light transmittance (w).
    pub lit: Array,
    grid: wgpu::Buffer,
    empty: wgpu::Buffer,
    passes: [Pass; 3],
    /// Position version for which the shadows were computed.
    made_of: Option<u64>,
    generation: u64,
}

impl Raycaster {
    /// Records the shadow passes after the gradient pass; `gradients_changed` is whether the
    /// gradients were recomputed.
    pub(super) fn record_shadows(
        &mut self,
        work: &mut Recorder,
        gradients_changed: bool,
    ) -> Result<()> {
        let generation = self.geometry.generation;
        if self
            .shadows
            .as_ref()
            .is_none_or(|s| s.generation != generation)
        {
            self.shadows = self.make_shadows()?;
        }
        let version = Some(self.geometry.positions.version());
        if let Some(shadows) = &mut self.shadows
            && (gradients_changed || shadows.made_of != version)
        {
            shadows.made_of = version;
            let (empty, grid) = (&shadows.empty, &shadows.grid);
            work.encoder()
                .copy_buffer_to_buffer(empty, 0, grid, 0, empty.size());
            shadows.passes.iter().for_each(|pass| pass.record(work));
        }
        Ok(())
    }

    /// Creates the shadow passes; `None` without the volume.
    fn make_shadows(&self) -> Result<Option<Shadows>> {
        let (gpu, geometry, looks) = (&self.gpu, &self.geometry, &self.looks);
        // Without the volume, surfaces cast no shadows.
        let gradients = geometry.gradients().filter(|_| looks.inside().draw_volume);
        let Some(gradients) = gradients else {
            return Ok(None);
        };
        let nodes = geometry.projected.len();
        let ShadowResolution { cells, points } =
            ShadowResolution::of(geometry.tet_count() as usize);
        // Per axis, the minimum starts at the largest and the maximum at the smallest u32.
        let mut empty = vec![0u32; 6 + cells as usize];
        empty[..3].fill(u32::MAX);
        let grid = gpu.buffer_of("grid of shadows", &empty)?;
        let empty = gpu.buffer_of("grid of shadows, empty", &empty)?;
        let ways = LightDirections::to(self.options.light, cells);
        let list: Vec<[f32; 4]> = ways
            .list
            .iter()
            .map(|w| w.as_vec3().extend(0.0).to_array())
            .collect();
        let directions = gpu.array_of("directions to the light", Texel::F32x4, &list)?;
        let lit = gpu.array("lit gradients", Texel::F32x4, nodes as usize)?;
        let bounds = gpu
            .pass("render/shadow_bounds")
            .read(&geometry.positions)
            .write(&grid)
            .params(&gpu_data::Bounds { nodes })
            .dispatch_items(nodes)?;
        let fill = self.fill_pass(&grid, cells, points)?;
        let march = gpu
            .pass("render/shadow_march")
            .read(&geometry.positions)
            .read(gradients)
            .read(&directions)
            .read(&grid)
            .write(&lit)
            .params(&gpu_data::March {
                nodes,
                cells,
                directions: list.len() as u32,
                steps: ways.steps,
                opacity: looks.table.opacity,
                normalisation: ways.normalisation as f32,
                strength: self.options.shadows as f32,
                surface_offset: SURFACE_OFFSET as f32,
                gradient_half_saturation: GRADIENT_HALF_SATURATION as f32,
            })
            .dispatch_items(nodes)?;
        Ok(Some(Shadows {
            lit,
            grid,
            empty,
            passes: [bounds, fill, march],
            made_of: None,
            generation: self.geometry.generation,
        }))
    }

    /// Creates the pass that fills the grid with the extinction of the tets, at `points` points each.
    fn fill_pass(&self, grid: &wgpu::Buffer, cells: u32, points: u32) -> Result<Pass> {
        let (geometry, looks) = (&self.geometry, &self.looks);
        let resting = looks.needs_rest();
        let rests = geometry
            .rest_positions()
            .filter(|_| resting)
            .unwrap_or(&looks.sections);
        let flag = |on: bool| f64::from(u8::from(on));
        let [clips, ..] = looks.inside().counts();
        let scans = looks.scans();
        let name = match scans {
            Some(_) => "render/shadow_fill scan",
            None => "render/shadow_fill",
        };
        let mut fill = self
            .gpu
            .pass(name)
            .constant("CELL_SCALARS", flag(geometry.is_cell_scalar))
            .constant("REGIONS", flag(looks.rows().is_some()))
            .constant("CLIP_PLANE_COUNT", clips as f64)
            .constant("USE_REST_POSITIONS", flag(resting))
            .read(&geometry.positions)
            .read(&geometry.scalars)
            .read(&geometry.tets)
            .read(&geometry.cells)
            .read(&looks.colours)
            .read(looks.rows().unwrap_or(&self.no_rows))
            .read(&looks.sections)
            .read(rests);
        if let Some((held, places)) = scans {
            fill = fill
                .read(&held.texture)
                .read(&held.sampler)
                .read(places)
                .constant("SCAN_COUNT", held.scans.len() as f64)
                .constant("LABELS", flag(held.has_labels()));
        }
        let params = gpu_data::Fill {
            tets: geometry.tet_count(),
            cells,
            points,
        };
        fill.write(grid)
            .params(&params)
            .dispatch_items(geometry.tet_count())
    }

    /// Returns the gradients used for lighting at the nodes (xyz, local frame) with the light
    /// transmittance (w), as of the last image with shadows; `None` without shadows.
    pub fn shadowed_gradients(&self) -> Option<&Array> {
        self.shadows.as_ref().map(|s| &s.lit)
    }
}
