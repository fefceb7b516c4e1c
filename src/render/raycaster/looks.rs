//! What rays see in a mesh: transfer functions, of all or of each region, planes and isosurfaces,
//! as the walks read them.

use crate::gpu::{Array, Gpu, Texel};
use crate::render::geometry::Geometry;
use crate::render::inside::{Inside, colours};
use crate::render::table::{Table, Wanted};
use crate::render::{RaycastOptions, ResolvedTransfer, TransferFunction};
use crate::{Error, Result};

/// What is not shown at all; `lib/segment.wgsl` has the same number.
const HIDDEN: u32 = 0xffff;
/// Transfer functions in a table: two rows of texels each, within what every device holds.
const MOST_LOOKS: usize = 1024;

/// What each region of a body looks like.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RegionLooks {
    /// The transfer functions; up to 1,024.
    pub transfers: Vec<TransferFunction>,
    /// Of each tet, in the order of the mesh, which of them; none for a tet that is not shown.
    pub of_tets: Vec<Option<u32>>,
}

/// Regions as they are drawn.
struct Regions {
    transfers: Vec<TransferFunction>,
    /// The row of each tet, where the geometry keeps it.
    rows: Array,
    /// Tets there were.
    tets: u32,
}

/// All that decides what a segment of a ray looks like.
pub(in crate::render) struct Looks {
    transfer: TransferFunction,
    regions: Option<Regions>,
    inside: Inside,
    /// The range of scalars that the table was made for.
    range: (f64, f64),
    pub table: Table,
    /// Planes and isosurfaces.
    pub cuts: Array,
    pub colours: Array,
}

impl Looks {
    pub fn new(
        gpu: &Gpu,
        geometry: &Geometry,
        options: &RaycastOptions,
        transfer: &TransferFunction,
    ) -> Result<Looks> {
        let transfers = resolved(geometry, transfer, None);
        let table = make_table(gpu, geometry, options, &transfers)?;
        let inside = Inside::default();
        Ok(Looks {
            cuts: cuts(gpu, geometry, &table, &inside)?,
            colours: colours(gpu, &transfers, geometry.range, most(geometry, &table))?,
            range: geometry.range,
            transfer: transfer.clone(),
            regions: None,
            inside,
            table,
        })
    }

    pub fn transfer(&self) -> &TransferFunction {
        &self.transfer
    }

    /// Whether its table is the one for the scalars that `geometry` has now.
    pub fn suit(&self, geometry: &Geometry, options: &RaycastOptions) -> bool {
        let transfers = resolved(geometry, &self.transfer, self.regions.as_ref());
        self.range == geometry.range && self.table.suits(&wanted(geometry, options, &transfers))
    }

    pub fn inside(&self) -> &Inside {
        &self.inside
    }

    /// The row of each tet, where regions have looks of their own.
    pub fn rows(&self) -> Option<&Array> {
        self.regions.as_ref().map(|r| &r.rows)
    }

    /// Whether they are those of `geometry` as it is now.
    pub fn check(&self, geometry: &Geometry) -> Result<()> {
        match &self.regions {
            Some(regions) if regions.tets != geometry.tet_count() => Err(Error::Input(
                "the regions are those of the mesh before tets were removed; call Raycaster::set_regions again".into(),
            )),
            _ => Ok(()),
        }
    }

    pub fn set_transfer(
        &mut self,
        gpu: &Gpu,
        geometry: &Geometry,
        options: &RaycastOptions,
        transfer: &TransferFunction,
    ) -> Result<()> {
        let transfers = resolved(geometry, transfer, self.regions.as_ref());
        self.renew(gpu, geometry, options, &transfers)?;
        self.transfer = transfer.clone();
        Ok(())
    }

    pub fn set_options(
        &mut self,
        gpu: &Gpu,
        geometry: &Geometry,
        options: &RaycastOptions,
    ) -> Result<()> {
        let transfers = resolved(geometry, &self.transfer, self.regions.as_ref());
        self.renew(gpu, geometry, options, &transfers)
    }

    pub fn set_regions(
        &mut self,
        gpu: &Gpu,
        geometry: &Geometry,
        options: &RaycastOptions,
        regions: Option<&RegionLooks>,
    ) -> Result<()> {
        let regions = regions
            .map(|r| Regions::new(gpu, geometry, r))
            .transpose()?;
        let transfers = resolved(geometry, &self.transfer, regions.as_ref());
        self.renew(gpu, geometry, options, &transfers)?;
        self.regions = regions;
        Ok(())
    }

    pub fn set_inside(&mut self, gpu: &Gpu, geometry: &Geometry, inside: &Inside) -> Result<()> {
        inside.check()?;
        if inside.needs_rest() && geometry.rests().is_none() {
            return Err(Error::Input(
                "the geometry does not know where it rests; call Geometry::remember_rest first"
                    .into(),
            ));
        }
        if !inside.isosurfaces.is_empty() && geometry.per_cell {
            return Err(Error::Input(
                "isosurfaces need a field at the nodes: one that is constant in each tet has none"
                    .into(),
            ));
        }
        self.cuts = cuts(gpu, geometry, &self.table, inside)?;
        self.inside = inside.clone();
        Ok(())
    }

    /// Makes the table, and what goes by its coordinates, of other transfer functions.
    fn renew(
        &mut self,
        gpu: &Gpu,
        geometry: &Geometry,
        options: &RaycastOptions,
        transfers: &[ResolvedTransfer],
    ) -> Result<()> {
        let table = make_table(gpu, geometry, options, transfers)?;
        let cuts = cuts(gpu, geometry, &table, &self.inside)?;
        let colours = colours(gpu, transfers, geometry.range, most(geometry, &table))?;
        (self.table, self.cuts, self.colours) = (table, cuts, colours);
        self.range = geometry.range;
        Ok(())
    }
}

impl Regions {
    fn new(gpu: &Gpu, geometry: &Geometry, looks: &RegionLooks) -> Result<Regions> {
        let tets = geometry.tet_count();
        let count = looks.transfers.len();
        if looks.of_tets.len() != tets as usize {
            return Err(Error::Input(format!(
                "looks for {} tets are given, and the mesh has {tets}",
                looks.of_tets.len()
            )));
        }
        if !(1..=MOST_LOOKS).contains(&count) {
            return Err(Error::Input(format!(
                "regions have {count} transfer functions among them: from 1 to {MOST_LOOKS} are possible"
            )));
        }
        let mut rows = vec![HIDDEN; looks.of_tets.len()];
        for (place, look) in geometry.place.iter().zip(&looks.of_tets) {
            match look {
                Some(row) if *row as usize >= count => {
                    return Err(Error::Input(format!(
                        "a tet has transfer function {row}, and there are {count}, counted from 0"
                    )));
                }
                Some(row) => rows[*place as usize] = *row,
                None => {}
            }
        }
        Ok(Regions {
            transfers: looks.transfers.clone(),
            rows: gpu.array_of("looks of tets", Texel::U32, &rows)?,
            tets,
        })
    }
}

/// The transfer functions of the table's rows, in absolute terms.
fn resolved(
    geometry: &Geometry,
    transfer: &TransferFunction,
    regions: Option<&Regions>,
) -> Vec<ResolvedTransfer> {
    let transfers = regions.map_or(std::slice::from_ref(transfer), |r| &r.transfers);
    let resolved = |t: &TransferFunction| t.resolved(geometry.range, geometry.frame.scale);
    transfers.iter().map(resolved).collect()
}

fn make_table(
    gpu: &Gpu,
    geometry: &Geometry,
    options: &RaycastOptions,
    transfers: &[ResolvedTransfer],
) -> Result<Table> {
    Table::new(gpu, &wanted(geometry, options, transfers))
}

/// What the table is made for.
fn wanted<'a>(
    geometry: &'a Geometry,
    options: &RaycastOptions,
    transfers: &'a [ResolvedTransfer],
) -> Wanted<'a> {
    Wanted {
        form: options.table,
        texel: options.texel,
        size: options.table_size,
        transfers,
        range: geometry.range,
        scale: geometry.frame.scale,
        longest: geometry.longest_edge,
        mean: geometry.mean_chord,
        spread: &geometry.spread,
        accuracy: options.accuracy,
        opaque: options.opaque,
    }
}

/// The largest extinction, per file unit.
fn most(geometry: &Geometry, table: &Table) -> f64 {
    f64::from(table.opacity) / (geometry.frame.scale * std::f64::consts::LOG2_E)
}

/// Planes and isosurfaces as walks read them.
fn cuts(gpu: &Gpu, geometry: &Geometry, table: &Table, inside: &Inside) -> Result<Array> {
    let (low, high) = geometry.range;
    let [scale, shift] = table.scalar.map(f64::from);
    let coordinate = |s: f64| scale * (s - low) / (high - low) + shift;
    inside.to_gpu(gpu, geometry.frame, coordinate)
}
