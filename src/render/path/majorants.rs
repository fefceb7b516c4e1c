//! The largest extinction in each tet, with which paths sample their free flights.

use crate::Result;
use crate::gpu::{Array, Texel};
use crate::render::Raycaster;

mod gpu_data {
    crate::gpu_struct! {
        /// Parameters of `shaders/render/path_majorants.wgsl`.
        pub(super) struct Majorants {
            pub tets: u32,
        }
    }
}

impl Raycaster {
    /// Returns the majorant of each tet, relative to the largest extinction: of the scans in it, or
    /// of the scalar's range in it. Hidden tets have 0.
    pub(super) fn path_majorants(&self) -> Result<Array> {
        let (gpu, geometry, looks) = (&self.gpu, &self.geometry, &self.looks);
        if let Some(of_scans) = looks.scan_majorants(geometry) {
            return gpu.array_of("majorants", Texel::F32, &of_scans);
        }
        let tets = geometry.tet_count();
        let majorants = gpu.array("majorants", Texel::F32, tets as usize)?;
        let flag = |on: bool| f64::from(u8::from(on));
        let pass = gpu
            .pass("render/path_majorants")
            .constant("CELL_SCALARS", flag(geometry.is_cell_scalar))
            .constant("HAS_REGIONS", flag(looks.rows().is_some()))
            .read(&geometry.scalars)
            .read(&geometry.tets)
            .read(&geometry.cells)
            .read(looks.rows().unwrap_or(&self.no_rows))
            .read(&looks.colours)
            .write(&majorants)
            .params(&gpu_data::Majorants { tets })
            .dispatch_items(tets)?;
        let mut work = gpu.start_recording();
        pass.record(&mut work);
        work.submit()?;
        Ok(majorants)
    }
}
