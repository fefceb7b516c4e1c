//! Records of tets, for the walk over planes: made when that first asks, as nothing else reads
//! them.

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
        /// See `shaders/render/record_neighbours.wgsl`.
        pub(super) struct Neighbours {
            pub tets: u32,
        }
    }
}

/// Texels of a tet's record (see `refresh_geometry.wgsl`).
const RECORD_TEXELS: usize = 8;

/// The records, and the passes that fill them.
pub(super) struct TetRecords {
    array: Array,
    passes: Passes,
    /// Whether neighbours are those of the mesh as it is now.
    linked: bool,
    /// The version of the positions that planes and gradients were made for.
    made_of: Option<u64>,
}

struct Passes {
    neighbours: Pass,
    refresh: Pass,
}

/// Arrays of a geometry that records are made of.
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
                "the walk over planes keeps {} bytes for each tet, and this device can hold them for {most} tets; there are {tets}: walk over vertices (--walk vertices, Walk::Vertices), or use a coarser mesh",
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

    /// Has planes and gradients made anew.
    pub fn invalidate(&mut self) {
        self.made_of = None;
    }

    /// Has all made anew, of `sources`, where a cut has put others in the place of the old.
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
    /// What records are made of.
    pub(super) fn sources(&self) -> RecordInputs<'_> {
        RecordInputs {
            positions: &self.positions,
            scalars: &self.scalars,
            tets: &self.tets,
            links: &self.links,
        }
    }

    /// Normals, gradients and neighbours of each tet, eight texels each, as the walk over planes
    /// reads them; laid out as `shaders/render/refresh_geometry.wgsl` says. None until
    /// [`Geometry::record_refresh`] makes them: the walk over vertices needs none.
    pub fn records(&self) -> Option<&Array> {
        self.records.as_ref().map(|records| &records.array)
    }

    /// Records the refresh of normals and gradients, if the positions changed since the last. The
    /// first time it makes the records: 128 bytes a tet.
    ///
    /// # Errors
    /// [`Error::Gpu`] when they do not fit the device.
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
    fn records_that_do_not_fit_are_refused_with_the_walk_that_needs_none() {
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
        let said = made(most + 1).unwrap_err().to_string();
        assert!(
            said.contains("--walk vertices") && said.contains(&most.to_string()),
            "{said}"
        );
    }
}
