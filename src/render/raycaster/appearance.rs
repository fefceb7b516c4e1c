//! Appearance of ray segments: transfer functions (global or per region), scans, section planes and
//! isosurfaces, in the form that the traversal shaders read.

use crate::gpu::{Array, Gpu, Texel};
use crate::render::geometry::Geometry;
use crate::render::scan::ScanSet;
use crate::render::sections::{Sections, colours};
use crate::render::table::{Table, TableKind, TableRequest, TableRow};
use crate::render::{RaycastOptions, TransferFunction};
use crate::{Error, Result};
use std::sync::Arc;

/// Row of a tet that is not drawn; same value as in `lib/segment.wgsl`.
const HIDDEN_ROW: u32 = 0xffff;
/// Flag on the row of a tet in which the scans are fully transparent; same value as in
/// `lib/segment.wgsl`.
const TRANSPARENT_FLAG: u32 = 0x8000;
/// Maximum number of transfer functions in a table: each takes two rows of texels, within the
/// texture size limit of every device.
const MAX_TRANSFER_FUNCTIONS: usize = 1024;

/// Appearance of each region of a body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RegionAppearance {
    /// Transfer functions, at most 1,024.
    pub transfers: Vec<TransferFunction>,
    /// Index into `transfers` of each tet, in mesh order; `None` for a tet that is not drawn.
    pub tet_regions: Vec<Option<u32>>,
}

/// Validated per-region appearance.
#[derive(Clone)]
struct Regions {
    transfers: Vec<TransferFunction>,
    /// Row of each tet, in mesh order.
    of_tets: Arc<[u32]>,
}

/// Appearance settings requested by the caller.
#[derive(Clone)]
struct RequestedAppearance {
    /// Transfer function of the scalars of the mesh.
    transfer: TransferFunction,
    /// Transfer function of the first scan, if that scan holds values rather than labels.
    of_scan: Option<TransferFunction>,
    regions: Option<Regions>,
    inside: Sections,
    scans: Option<Arc<ScanSet>>,
}

/// Settings and GPU resources that determine the appearance of a ray segment.
pub(in crate::render) struct Appearance {
    requested: RequestedAppearance,
    /// Scalar range that the table covers.
    range: (f64, f64),
    pub table: Table,
    /// Section planes and isosurfaces.
    pub sections: Array,
    pub colours: Array,
    /// Row of each tet, in the tet order of the geometry; present if regions have their own
    /// appearance or scans are shown.
    rows: Option<Array>,
    /// Placement of the scans, if any are shown.
    scans: Option<wgpu::Buffer>,
}

impl Appearance {
    pub fn new(
        gpu: &Gpu,
        geometry: &Geometry,
        options: &RaycastOptions,
        transfer: &TransferFunction,
    ) -> Result<Appearance> {
        let requested = RequestedAppearance {
            transfer: transfer.clone(),
            of_scan: None,
            regions: None,
            inside: Sections::default(),
            scans: None,
        };
        Appearance::of(gpu, geometry, options, requested)
    }

    fn of(
        gpu: &Gpu,
        geometry: &Geometry,
        options: &RaycastOptions,
        requested: RequestedAppearance,
    ) -> Result<Appearance> {
        requested.check(geometry)?;
        let (rows, first) = requested.rows(geometry);
        let table = Table::new(gpu, &requested.wanted(geometry, options, &rows))?;
        let scans = match &requested.scans {
            Some(held) => Some(held.to_gpu(gpu, geometry.frame, first)?),
            None => None,
        };
        Ok(Appearance {
            sections: cuts(gpu, geometry, rows[0].range, &table, &requested.inside)?,
            colours: requested.colours(gpu, &rows, first, max_extinction(geometry, &table))?,
            rows: requested.tet_rows(gpu, geometry, &rows, first)?,
            range: rows[0].range,
            scans,
            table,
            requested,
        })
    }

    /// Returns the transfer function of the displayed quantity (mesh scalars or first scan).
    pub fn transfer(&self) -> &TransferFunction {
        self.requested.shown()
    }

    /// Returns the scalar range that the transfer function covers.
    pub fn range(&self) -> (f64, f64) {
        self.range
    }

    /// Whether the table is still valid for the current scalars of `geometry`.
    pub fn matches(&self, geometry: &Geometry, options: &RaycastOptions) -> bool {
        let (rows, _) = self.requested.rows(geometry);
        let wanted = self.requested.wanted(geometry, options, &rows);
        self.range == rows[0].range && self.table.matches(&wanted)
    }

    pub fn inside(&self) -> &Sections {
        &self.requested.inside
    }

    /// Returns the displayed scans and the buffer of their placement.
    pub fn scans(&self) -> Option<(&ScanSet, &wgpu::Buffer)> {
        self.requested.scans.as_deref().zip(self.scans.as_ref())
    }

    /// Returns the largest extinction of the scans in each tet, relative to the largest of all, in
    /// the tet order of the geometry; `None` without scans. Hidden tets have 0.
    pub fn scan_majorants(&self, geometry: &Geometry) -> Option<Vec<f32>> {
        let held = self.requested.scans.as_ref()?;
        let (rows, first) = self.requested.rows(geometry);
        let most = max_extinction(geometry, &self.table);
        let of_tets = self.requested.regions.as_ref().map(|r| &r.of_tets);
        let own = |t: usize| of_tets.map_or(0, |rows| rows[t]);
        let row = |t: usize| (own(t) as usize).min(first - 1);
        let found = held.majorants(&rows, first, &row);
        let mut placed = vec![0.0; found.len()];
        for (t, sigma) in found.into_iter().enumerate() {
            if own(t) != HIDDEN_ROW && most > 0.0 {
                // Rounding must not exceed the majorant.
                placed[geometry.tet_order[t] as usize] = (1.000_01 * sigma / most) as f32;
            }
        }
        Some(placed)
    }

    /// Whether the traversal needs rest positions.
    pub fn needs_rest(&self) -> bool {
        self.requested.inside.needs_rest_positions() || self.requested.scans.is_some()
    }

    /// Returns the row of each tet, or `None` if all tets use the first row.
    pub fn rows(&self) -> Option<&Array> {
        self.rows.as_ref()
    }

    /// Checks that scans and regions match the current tet count of `geometry`.
    pub fn check(&self, geometry: &Geometry) -> Result<()> {
        let tets = geometry.tet_count() as usize;
        match (&self.requested.scans, &self.requested.regions) {
            (Some(held), _) if held.tets() != tets => Err(Error::Input(
                "the scans do not match the mesh because tets were removed; call Raycaster::set_scans again".into(),
            )),
            (_, Some(regions)) if regions.of_tets.len() != tets => Err(Error::Input(
                "the regions do not match the mesh because tets were removed; call Raycaster::set_regions again".into(),
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
        let mut requested = self.requested.clone();
        *requested
            .of_scan
            .as_mut()
            .unwrap_or(&mut requested.transfer) = transfer.clone();
        *self = Appearance::of(gpu, geometry, options, requested)?;
        Ok(())
    }

    pub fn set_options(
        &mut self,
        gpu: &Gpu,
        geometry: &Geometry,
        options: &RaycastOptions,
    ) -> Result<()> {
        *self = Appearance::of(gpu, geometry, options, self.requested.clone())?;
        Ok(())
    }

    pub fn set_regions(
        &mut self,
        gpu: &Gpu,
        geometry: &Geometry,
        options: &RaycastOptions,
        regions: Option<&RegionAppearance>,
    ) -> Result<()> {
        let mut requested = self.requested.clone();
        requested.regions = regions.map(|r| Regions::new(geometry, r)).transpose()?;
        *self = Appearance::of(gpu, geometry, options, requested)?;
        Ok(())
    }

    pub fn set_scans(
        &mut self,
        gpu: &Gpu,
        geometry: &Geometry,
        options: &RaycastOptions,
        held: Option<ScanSet>,
    ) -> Result<()> {
        let mut requested = self.requested.clone();
        if geometry.rest_positions().is_none() && held.is_some() {
            return Err(Error::Input(MISSING_REST_MESSAGE.into()));
        }
        requested.of_scan = held.as_ref().and_then(ScanSet::transfer).cloned();
        requested.scans = held.map(Arc::new);
        *self = Appearance::of(gpu, geometry, options, requested)?;
        Ok(())
    }

    /// Replaces the scans by `held`, which has been updated after a cut.
    pub fn update_scans_after_cut(
        &mut self,
        gpu: &Gpu,
        geometry: &Geometry,
        options: &RaycastOptions,
        held: ScanSet,
    ) -> Result<()> {
        let mut requested = self.requested.clone();
        requested.scans = Some(Arc::new(held));
        *self = Appearance::of(gpu, geometry, options, requested)?;
        Ok(())
    }

    pub fn set_sections(
        &mut self,
        gpu: &Gpu,
        geometry: &Geometry,
        options: &RaycastOptions,
        inside: &Sections,
    ) -> Result<()> {
        inside.check()?;
        if inside.needs_rest_positions() && geometry.rest_positions().is_none() {
            return Err(Error::Input(MISSING_REST_MESSAGE.into()));
        }
        let mut requested = self.requested.clone();
        requested.inside = inside.clone();
        if requested.scans.is_some() && self.requested.inside.isosurfaces != inside.isosurfaces {
            // The transparency of a tet depends on the isosurfaces.
            *self = Appearance::of(gpu, geometry, options, requested)?;
            return Ok(());
        }
        requested.check(geometry)?;
        self.sections = cuts(gpu, geometry, self.range, &self.table, inside)?;
        self.requested = requested;
        Ok(())
    }
}

const MISSING_REST_MESSAGE: &str =
    "the geometry has no rest positions; call Geometry::store_rest_positions first";

impl RequestedAppearance {
    /// Returns the transfer function of the displayed quantity.
    fn shown(&self) -> &TransferFunction {
        self.of_scan.as_ref().unwrap_or(&self.transfer)
    }

    /// Rejects inconsistent settings.
    fn check(&self, geometry: &Geometry) -> Result<()> {
        let flat = match &self.scans {
            Some(held) => held.transfer().is_none(),
            None => geometry.is_cell_scalar,
        };
        if !self.inside.isosurfaces.is_empty() && flat {
            return Err(Error::Input(
                "isosurfaces need a field at the nodes or a scan of values; fields that are constant in each tet and label maps have no isosurfaces"
                    .into(),
            ));
        }
        Ok(())
    }

    /// Returns the table rows with absolute transfer functions, and the number of rows that belong
    /// to the mesh scalar or to the first scan.
    fn rows(&self, geometry: &Geometry) -> (Vec<TableRow>, usize) {
        let own = std::slice::from_ref(self.shown());
        let transfers = self.regions.as_ref().map_or(own, |r| &r.transfers);
        let extent = geometry.frame.scale;
        let rows = match &self.scans {
            Some(held) => held.rows(transfers, extent),
            None => {
                let row = |t: &TransferFunction| TableRow {
                    transfer: t.to_absolute(geometry.range, extent),
                    range: geometry.range,
                    spread: geometry.spread.clone(),
                };
                transfers.iter().map(row).collect()
            }
        };
        (rows, transfers.len())
    }

    /// Returns the specification of the table.
    fn wanted<'a>(
        &self,
        geometry: &Geometry,
        options: &RaycastOptions,
        rows: &'a [TableRow],
    ) -> TableRequest<'a> {
        let (form, mean) = match (&self.scans, options.table) {
            // With scans, segments are as short as a voxel.
            (Some(held), form) => (
                if form == TableKind::Auto {
                    TableKind::Integrals
                } else {
                    form
                },
                geometry
                    .mean_chord
                    .min(options.scan_step * held.min_texel_spacing() / geometry.frame.scale),
            ),
            (None, form) => (form, geometry.mean_chord),
        };
        TableRequest {
            form,
            texel: options.texel,
            size: options.table_size,
            rows,
            scale: geometry.frame.scale,
            longest_segment: geometry.longest_edge,
            mean_segment: mean,
            accuracy: options.table_tolerance,
            opaque: options.opacity_cutoff,
        }
    }

    /// Uploads the colours of each row in the layout of `lib/sections.wgsl`; w is the extinction
    /// divided by `max_extinction`.
    fn colours(
        &self,
        gpu: &Gpu,
        rows: &[TableRow],
        first: usize,
        max_extinction: f64,
    ) -> Result<Array> {
        let over = if max_extinction > 0.0 {
            max_extinction.recip()
        } else {
            0.0
        };
        let mut all: Vec<Vec<[f64; 4]>> = rows.iter().map(colours).collect();
        for (row, looks) in self.scans.iter().flat_map(|held| held.label_rows(first)) {
            for (texel, look) in all[row].iter_mut().zip(looks) {
                let [r, g, b] = look.colour;
                *texel = [r, g, b, look.extinction];
            }
        }
        let texels = all.iter().flatten();
        let texels: Vec<[f32; 4]> = texels
            .map(|[r, g, b, tau]| [*r, *g, *b, over * tau].map(|x| x as f32))
            .collect();
        gpu.array_of("colours", Texel::F32x4, &texels)
    }

    /// Uploads the row of each tet in the tet order of the geometry; `None` if all tets use the
    /// first row.
    fn tet_rows(
        &self,
        gpu: &Gpu,
        geometry: &Geometry,
        rows: &[TableRow],
        first: usize,
    ) -> Result<Option<Array>> {
        if self.regions.is_none() && self.scans.is_none() {
            return Ok(None);
        }
        let tets = geometry.tet_count() as usize;
        let mut of_tets = match &self.regions {
            Some(regions) if regions.of_tets.len() == tets => regions.of_tets.to_vec(),
            // The regions belong to the mesh before a cut; `check` rejects drawing with them.
            _ => vec![0; tets],
        };
        if let Some(held) = self.scans.as_ref().filter(|held| held.tets() == tets) {
            let values: Vec<f64> = self
                .inside
                .isosurfaces
                .iter()
                .map(|iso| iso.value)
                .collect();
            let own = of_tets.clone();
            let row = |t: usize| (own[t] as usize).min(first - 1);
            let clear = held.transparent_tets(rows, first, &row, &values);
            for (row, clear) in of_tets.iter_mut().zip(clear) {
                if clear && *row != HIDDEN_ROW {
                    *row |= TRANSPARENT_FLAG;
                }
            }
        }
        let mut placed = vec![0; tets];
        for (place, row) in geometry.tet_order.iter().zip(of_tets) {
            placed[*place as usize] = row;
        }
        Ok(Some(gpu.array_of(
            "table rows of tets",
            Texel::U32,
            &placed,
        )?))
    }
}

impl Regions {
    fn new(geometry: &Geometry, looks: &RegionAppearance) -> Result<Regions> {
        let tets = geometry.tet_count();
        let count = looks.transfers.len();
        if looks.tet_regions.len() != tets as usize {
            return Err(Error::Input(format!(
                "region appearance must have one entry per tet, got {} for {tets} tets",
                looks.tet_regions.len()
            )));
        }
        if !(1..=MAX_TRANSFER_FUNCTIONS).contains(&count) {
            return Err(Error::Input(format!(
                "number of transfer functions of the regions must be 1 to {MAX_TRANSFER_FUNCTIONS}, got {count}"
            )));
        }
        if let Some(row) = looks
            .tet_regions
            .iter()
            .flatten()
            .find(|r| **r as usize >= count)
        {
            return Err(Error::Input(format!(
                "transfer function index of a tet must be < {count}, got {row}"
            )));
        }
        let rows = looks
            .tet_regions
            .iter()
            .map(|row| row.unwrap_or(HIDDEN_ROW));
        Ok(Regions {
            transfers: looks.transfers.clone(),
            of_tets: rows.collect(),
        })
    }
}

/// Returns the maximum extinction, per file length unit.
fn max_extinction(geometry: &Geometry, table: &Table) -> f64 {
    f64::from(table.opacity) / (geometry.frame.scale * std::f64::consts::LOG2_E)
}

/// Uploads planes and isosurfaces for scalars in the range `(low, high)`.
fn cuts(
    gpu: &Gpu,
    geometry: &Geometry,
    (low, high): (f64, f64),
    table: &Table,
    inside: &Sections,
) -> Result<Array> {
    let [scale, shift] = table.scalar.map(f64::from);
    let coordinate = |s: f64| scale * (s - low) / (high - low) + shift;
    inside.to_gpu(gpu, geometry.frame, coordinate)
}
