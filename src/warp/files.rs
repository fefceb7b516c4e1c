//! Writes warped scans and displacement fields as files; memory holds only the scan and a few
//! planes.

use super::field::lps;
use super::image::Sampler;
use super::voxel_cover::Plane;
use super::{Coverage, Warp, WarpOptions};
use crate::io::{Layout, OutFile, VolumeFormat, VolumeStream, atomic_write};
use crate::mesh::ScalarType;
use crate::volume::{Grid, Volume};
use crate::{Error, Result};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// Output files: `.nii.gz`, `.nrrd` or `.mha`.
///
/// Displacement fields are images of vectors of three 32-bit numbers in mm, in LPS regardless of
/// the coordinate system of the format, as ITK and tools based on it expect.
#[derive(Clone, Copy, Debug, Default)]
pub struct WarpFiles<'a> {
    /// The scan in the deformed body, on the output grid.
    pub image: Option<&'a Path>,
    /// The displacement from rest to the deformed state, on the scan's grid.
    pub displacement: Option<&'a Path>,
    /// The displacement from the deformed state to rest, on the output grid: the field that
    /// resamples the scan to the image.
    pub inverse: Option<&'a Path>,
}

/// Statistics of the written files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WarpReport {
    /// Coverage of the output grid by the deformed body, if image or inverse are written.
    pub bent: Option<Coverage>,
    /// Coverage of the scan's grid by the body at rest, if the displacement is written.
    pub rest: Option<Coverage>,
    /// Tetrahedra that are degenerate or inverted in the deformed body.
    pub inverted: usize,
}

impl WarpFiles<'_> {
    /// Validates the file names before any work.
    ///
    /// # Errors
    /// [`Error::Input`] for an extension that is no volume format, a folder that does not exist,
    /// two files with the same name, or no file at all.
    pub fn check(&self) -> Result<()> {
        let all = [self.image, self.displacement, self.inverse];
        let all: Vec<&Path> = all.into_iter().flatten().collect();
        for (n, path) in all.iter().enumerate() {
            VolumeFormat::from_path(path)?;
            let folder = path.parent().filter(|f| !f.as_os_str().is_empty());
            if let Some(folder) = folder.filter(|f| !f.is_dir()) {
                return Err(Error::Input(format!(
                    "{}: the output folder {} does not exist; create it first",
                    path.display(),
                    folder.display()
                )));
            }
            if all[..n].iter().any(|other| placed(other) == placed(path)) {
                return Err(Error::Input(format!(
                    "{}: two outputs have the same name; give each output a different name",
                    path.display()
                )));
            }
        }
        match all.is_empty() {
            true => Err(Error::Input(
                "no output file is given; give at least one".into(),
            )),
            false => Ok(()),
        }
    }
}

impl Warp<'_> {
    /// Writes `files` of `scan`, the image and the inverse on `grid`, and calls `progress` with the
    /// number of completed planes and the total. Outputs are written atomically: either all files
    /// or none.
    ///
    /// # Errors
    /// As [`WarpFiles::check`], [`Warp::image`] and [`Warp::displacement`]; an error if a format
    /// cannot store the data or a file cannot be written.
    pub fn write(
        &self,
        scan: &Volume,
        grid: &Grid,
        options: &WarpOptions,
        files: &WarpFiles,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<WarpReport> {
        files.check()?;
        let mut report = WarpReport {
            inverted: self.inverted(),
            ..WarpReport::default()
        };
        let bent = [files.image, files.inverse].iter().any(Option::is_some);
        let planes_of = |wanted: bool, grid: &Grid| if wanted { grid.size[2] } else { 0 };
        let of_rest = planes_of(files.displacement.is_some(), &scan.grid());
        let planes = planes_of(bent, grid) + of_rest;
        let mut done = 0;
        let mut step = || {
            done += 1;
            progress(done, planes);
        };
        // Before any work, to detect early a background that cannot be stored.
        let sampler = files.image.map(|_| Sampler::new(scan, grid, options));
        let sampler = sampler.transpose()?;
        let scans = scan.grid();
        let layout = Layout {
            grid: *grid,
            ..Layout::of(scan)
        };
        // The atomic writes are nested and all streams are closed in the innermost one, so that
        // either all files are written or none.
        let mut fill = |[mut displacement, mut image, mut inverse]: Streams<'_>| {
            if displacement.is_some() {
                report.rest = Some(self.write_rest(&scans, &mut displacement, &mut step)?);
            }
            if bent {
                let mut both = (image.as_mut(), inverse.as_mut());
                let coverage = self.write_bent(sampler.as_ref(), grid, &mut both, &mut step)?;
                report.bent = Some(coverage);
            }
            let mut streams = [displacement, image, inverse].into_iter().flatten();
            streams.try_for_each(VolumeStream::close)
        };
        opened(files.displacement, vectors(&scans), &mut |displacement| {
            let mut displacement = displacement;
            opened(files.image, layout.clone(), &mut |image| {
                let (displacement, mut image) = (&mut displacement, image);
                opened(files.inverse, vectors(grid), &mut |inverse| {
                    fill([displacement.take(), image.take(), inverse])
                })
            })
        })?;
        Ok(report)
    }

    /// Writes the planes of the displacement from rest to the deformed state.
    fn write_rest(
        &self,
        grid: &Grid,
        stream: &mut Option<VolumeStream>,
        step: &mut dyn FnMut(),
    ) -> Result<Coverage> {
        let mut coverage = Coverage::default();
        let map_direction = self.forward();
        let make = |plane: Plane| (lps(&plane), plane.coverage);
        map_direction.for_each_plane(grid, make, &mut |(bytes, own)| {
            coverage.add(own);
            step();
            stream.iter_mut().try_for_each(|s| s.push(&bytes))
        })?;
        coverage.require_any(&map_direction, grid)?;
        Ok(coverage)
    }

    /// Writes the planes of the image and of the displacement from the deformed state to rest, as
    /// requested.
    fn write_bent(
        &self,
        sampler: Option<&Sampler>,
        grid: &Grid,
        (image, inverse): &mut (Option<&mut VolumeStream>, Option<&mut VolumeStream>),
        step: &mut dyn FnMut(),
    ) -> Result<Coverage> {
        let mut coverage = Coverage::default();
        let map_direction = self.backward();
        let with_inverse = inverse.is_some();
        let make = |plane: Plane| {
            let values = sampler.map(|sampler| sampler.sample_plane(&plane));
            let (bytes, beyond) = values.map_or((Vec::new(), 0), |(raw, n)| (raw.to_bytes(), n));
            let vectors = if with_inverse {
                lps(&plane)
            } else {
                Vec::new()
            };
            let own = plane.coverage;
            (bytes, vectors, Coverage { beyond, ..own })
        };
        map_direction.for_each_plane(grid, make, &mut |(bytes, vectors, own)| {
            coverage.add(own);
            step();
            image.iter_mut().try_for_each(|s| s.push(&bytes))?;
            inverse.iter_mut().try_for_each(|s| s.push(&vectors))
        })?;
        coverage.require_any(&map_direction, grid)?;
        coverage.require_scan()?;
        Ok(coverage)
    }
}

/// Returns the layout of a displacement file.
fn vectors(grid: &Grid) -> Layout<'static> {
    Layout {
        grid: *grid,
        scalar: ScalarType::F32,
        components: 3,
        slope: 1.0,
        intercept: 0.0,
        names: None,
    }
}

/// Streams of the requested outputs: displacement, image, inverse.
type Streams<'a> = [Option<VolumeStream<'a>>; 3];

/// Returns the canonical location of a file, to detect different spellings of the same name.
fn placed(path: &Path) -> PathBuf {
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    let folder = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_path_buf());
    path.file_name()
        .map_or(folder.clone(), |name| folder.join(name))
}

/// Calls `fill` to write and close the volume at `path`, if given; the file appears only on
/// success.
fn opened(
    path: Option<&Path>,
    layout: Layout,
    fill: &mut dyn FnMut(Option<VolumeStream>) -> Result<()>,
) -> Result<()> {
    let Some(path) = path else {
        return fill(None);
    };
    atomic_write(path, |file: &mut BufWriter<OutFile>| {
        fill(Some(VolumeStream::begin(path, layout, file)?))
    })
}
