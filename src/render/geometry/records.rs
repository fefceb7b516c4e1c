//! Tet records for the plane traversal, created on first use because nothing else reads them.

use super::Geometry;
use crate::gpu::{Array, Gpu, Pass, Recorder, Texel};
use crate::{Error, Result};

mod gpu_data {
    crate::gpu_struct! {
        pub(super) struct Refresh {
            pub tets: u32,
        }
    }
    crate::gpu_struct! {
        /// Parameters of `shaders/render/record_neighbours.wgsl`.
        pub(super) struct Neighbours {
            pub tets: u32,
        }
    }
}

/// Texels per tet record (see `refresh_geometry.wgsl`).
const RECORD_TEXELS: usize = 8;

/// Tet records, and the passes that fill them.
pub(super) struct TetRecords {
    array: Array,
    passes: Passes,
    /// Whether the neighbours are those of the current mesh.
    linked: bool,
    /// Version of the positions for which planes and gradients were computed.
    made_of: Option<u64>,
}

struct Passes {
    neighbours: Pass,
    refresh: Pass,
}

/// Arrays of a geometry from which the records are computed.
#[derive(Clone, Copy)]
pub(super) struct RecordInputs<'a> {
    pub positions: &'a Array,
    pub scalars: &'a Array,
    pub tets: &'a Array,
    pub links: &'a Array,
}

impl TetRecords {
    fn new(gpu: &Gpu, sources: RecordInputs) -> Result<TetRecords> {
        let (tets, most) = (sources.tets.len() as usize, gpu.max_items() / RECORD_TEXELS);
        if tets > most {
            return Err(Error::Gpu(format!(
                "the plane traversal stores {} bytes per tet, which this device can hold for {most} tets, got {tets}; use the vertex traversal (--walk vertices, Traversal::Vertices) or a coarser mesh",
                16 * RECORD_TEXELS
            )));
        }
        let array = gpu.array("tet records", Texel::U32x4, RECORD_TEXELS * tets)?;
        Ok(TetRecords {
            passes: passes(gpu, sources, &array)?,
            array,
            linked: false,
            made_of: None,
        })
    }

    /// Forces recomputation of planes and gradients.
    pub fn invalidate(&mut self) {
        self.made_of = None;
    }

    /// Rebinds the passes to `sources` after a cut and forces recomputation of all data.
    pub fn follow(&mut self, gpu: &Gpu, sources: RecordInputs) -> Result<()> {
        self.passes = passes(gpu, sources, &self.array)?;
        self.linked = false;
        self.made_of = None;
        Ok(())
    }
}

fn passes(gpu: &Gpu, sources: RecordInputs, records: &Array) -> Result<Passes> {
    let tets = sources.tets.len();
    Ok(Passes {
        neighbours: gpu
            .pass("render/record_neighbours")
            .read(sources.tets)
            .read(sources.links)
            .write(records)
            .params(&gpu_data::Neighbours { tets })
            .dispatch_items(tets)?,
        refresh: gpu
            .pass("render/refresh_geometry")
            .read(sources.positions)
            .read(sources.scalars)
            .read(sources.tets)
            .write(records)
            .params(&gpu_data::Refresh { tets })
            .dispatch_items(tets)?,
    })
}

impl Geometry {
    /// Returns the inputs of the records.
    pub(super) fn sources(&self) -> RecordInputs<'_> {
        RecordInputs {
            positions: &self.positions,
            scalars: &self.scalars,
            tets: &self.tets,
            links: &self.links,
        }
    }

    /// Returns the normals, gradients and neighbours of each tet for the plane traversal, eight
    /// texels per tet, in the layout of `shaders/render/refresh_geometry.wgsl`. `None` until
    /// [`Geometry::record_refresh`] creates them; the vertex traversal does not need them.
    pub fn records(&self) -> Option<&Array> {
        self.records.as_ref().map(|records| &records.array)
    }

    /// Records the update of normals and gradients if the positions have changed since the last
    /// one. The first call allocates the records: 128 bytes per tet.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the records do not fit the device.
    pub fn record_refresh(&mut self, work: &mut Recorder) -> Result<()> {
        let records = match self.records.take() {
            Some(records) => records,
            None => TetRecords::new(&self.gpu, self.sources())?,
        };
        let records = self.records.insert(records);
        if !records.linked {
            records.passes.neighbours.record(work);
            records.linked = true;
        }
        let version = Some(self.positions.version());
        if records.made_of != version {
            records.passes.refresh.record(work);
            records.made_of = version;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn oversized_tet_records_are_rejected_with_alternative() {
        let gpu = Gpu::new().unwrap();
        let most = gpu.max_items() / RECORD_TEXELS;
        let [positions, scalars] = [Texel::F32x4, Texel::F32].map(|texel| gpu.array("a", texel, 4));
        let (positions, scalars) = (positions.unwrap(), scalars.unwrap());
        let links = gpu.array("links", Texel::U32x2, 16).unwrap();
        let made = |tets: usize| {
            let tets = gpu.array("tets", Texel::U32x4, tets).unwrap();
            let sources = RecordInputs {
                positions: &positions,
                scalars: &scalars,
                tets: &tets,
                links: &links,
            };
            TetRecords::new(&gpu, sources).map(|_| ())
        };
        assert!(made(4).is_ok());
        let error = made(most + 1).unwrap_err().to_string();
        assert!(
            error.contains("--walk vertices") && error.contains(&most.to_string()),
            "{error}"
        );
    }
}
