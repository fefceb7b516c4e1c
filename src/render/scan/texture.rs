//! Texture of all scans of an image: one half-float 3D texture with the scans stacked along z.
//! Texels are values scaled to −1…1 over the range that occurs, or label numbers. Scans that exceed
//! the device limits are downsampled by factors of two; along z only if there are too many layers.

use super::labels::LabelIndex;
use super::{Scan, ScanAppearance};
use crate::gpu::Gpu;
use crate::volume::Volume;
use crate::{Error, Result, parallel};
use glam::{DAffine3, DVec3};
use half::f16;

/// Bytes uploaded at a time.
const UPLOAD_BYTES: usize = 32 << 20;
/// Margin, in multiples of the displayed range, to which values outside that range are clamped;
/// out-of-range values matter because they are interpolated with values in range.
const MARGIN: f64 = 4.0;
/// Maximum downsampling factor along each axis.
const MAX_DOWNSAMPLING: usize = 64;

/// Voxels of a scan in texture form.
pub(super) struct Texels {
    /// Downsampling factor along each axis, in voxels per texel.
    pub downsampling: [usize; 3],
    /// Texels along each axis.
    pub size: [usize; 3],
    /// Texels; i runs fastest, then j, then k.
    pub values: Vec<f16>,
    /// Values of the texels −1 and 1, for a scan of values.
    pub ends: (f64, f64),
    /// Label numbering, for a label map.
    pub label_index: Option<LabelIndex>,
    /// First layer in the texture, along z.
    pub first: u32,
}

impl Texels {
    /// Converts `scan`, with the downsampling factors `merged`.
    fn of(scan: &Scan, merged: [usize; 3]) -> Result<Texels> {
        let volume = &*scan.volume;
        let size: [usize; 3] = std::array::from_fn(|k| volume.size[k].div_ceil(merged[k]));
        let numbered = match &scan.appearance {
            ScanAppearance::Labels(_) => Some(LabelIndex::of(volume)?),
            ScanAppearance::Values { .. } => None,
        };
        let Some(ends) = volume.range() else {
            return Err(Error::Input(
                "the scan has no voxel with a finite value".into(),
            ));
        };
        let (low, high) = scan.range();
        let margin = MARGIN * (high - low);
        let ends = (ends.0.max(low - margin), ends.1.min(high + margin));
        let span = if ends.1 > ends.0 {
            ends.1 - ends.0
        } else {
            1.0
        };
        let ends = (ends.0, ends.0 + span);
        let texel = |value: f64| 2.0 * (value.clamp(ends.0, ends.1) - ends.0) / span - 1.0;
        let values = parallel::map(size.iter().product(), |n| {
            let low = [
                n % size[0] * merged[0],
                n / size[0] % size[1] * merged[1],
                n / size[0] / size[1] * merged[2],
            ];
            f16::from_f64(match &numbered {
                Some(numbered) if merged == [1; 3] => {
                    LabelIndex::to_texel(numbered.number(volume.value(n)))
                }
                Some(numbered) => {
                    LabelIndex::to_texel(most_frequent(volume, low, merged, numbered))
                }
                None => texel(mean(volume, low, merged).unwrap_or(ends.0)),
            })
        });
        Ok(Texels {
            downsampling: merged,
            size,
            values,
            ends,
            label_index: numbered,
            first: 0,
        })
    }

    /// Returns the transform from voxel to texel indices.
    pub fn texel_from_voxel(&self) -> DAffine3 {
        let merged = DVec3::from(self.downsampling.map(|n| n as f64));
        DAffine3::from_scale(merged.recip())
            * DAffine3::from_translation(-0.5 * (merged - DVec3::ONE))
    }

    /// Returns the value of a texel.
    pub fn value(&self, texel: f64) -> f64 {
        self.ends.0 + 0.5 * (texel + 1.0) * (self.ends.1 - self.ends.0)
    }
}

/// Returns the voxels of `volume` that are merged into one texel.
fn block(
    volume: &Volume,
    low: [usize; 3],
    merged: [usize; 3],
) -> impl Iterator<Item = f64> + use<'_> {
    let [nx, ny, nz] = volume.size;
    let along = move |k: usize, n: usize| low[k]..(low[k] + merged[k]).min(n);
    along(2, nz).flat_map(move |z| {
        along(1, ny)
            .flat_map(move |y| along(0, nx).map(move |x| volume.value(x + nx * (y + ny * z))))
    })
}

/// Returns the mean of the finite voxels of a block.
fn mean(volume: &Volume, low: [usize; 3], merged: [usize; 3]) -> Option<f64> {
    let finite = block(volume, low, merged).filter(|v| v.is_finite());
    let (sum, count) = finite.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// Returns the most frequent label number of a block; the smallest of equally frequent ones.
fn most_frequent(
    volume: &Volume,
    low: [usize; 3],
    merged: [usize; 3],
    numbered: &LabelIndex,
) -> usize {
    let mut numbers: Vec<usize> = block(volume, low, merged)
        .map(|v| numbered.number(v))
        .collect();
    numbers.sort_unstable();
    let runs = numbers.chunk_by(|a, b| a == b);
    // `max_by_key` returns the last of equal maxima, so the order is reversed.
    let best = runs.rev().max_by_key(|run| run.len());
    best.map_or(0, |run| run[0])
}

/// Creates the texture of all scans; returns its view, the texels of each scan, and a description
/// of omitted data.
pub(super) fn texture(
    gpu: &Gpu,
    scans: &[Scan],
) -> Result<(wgpu::TextureView, Vec<Texels>, Vec<String>)> {
    let limit = gpu.device().limits().max_texture_dimension_3d as usize;
    // The smallest power-of-two downsampling within the texture size limit.
    let side = |n: usize| {
        let mut merged = 1;
        while n.div_ceil(merged) > limit {
            merged *= 2;
        }
        merged
    };
    let mut merged: Vec<[usize; 3]> = scans.iter().map(|s| s.volume.size.map(side)).collect();
    loop {
        let mut parts = Vec::new();
        let mut size = [1usize, 1, 0];
        for (scan, merged) in scans.iter().zip(&merged) {
            let texels: [usize; 3] =
                std::array::from_fn(|k| scan.volume.size[k].div_ceil(merged[k]));
            size = [
                size[0].max(texels[0]),
                size[1].max(texels[1]),
                size[2] + texels[2],
            ];
        }
        let deep = size[2] > limit;
        let made = match !deep {
            true => make(gpu, size),
            false => Err(Error::Gpu(format!(
                "scans with {} layers in total exceed the texture limit of {limit} layers",
                size[2]
            ))),
        };
        let texture = match made {
            Ok(texture) => texture,
            Err(why) => {
                let parts = merged.iter_mut().zip(scans);
                let largest = parts.max_by_key(|(m, scan)| match deep {
                    true => scan.volume.size[2] / m[2],
                    false => scan.volume.voxels() / m.iter().product::<usize>(),
                });
                let Some((largest, _)) =
                    largest.filter(|(m, _)| m.iter().all(|n| *n < MAX_DOWNSAMPLING))
                else {
                    return Err(why);
                };
                let axes = if deep { 2..3 } else { 0..3 };
                largest[axes].iter_mut().for_each(|n| *n *= 2);
                continue;
            }
        };
        let mut first = 0;
        for (scan, merged) in scans.iter().zip(&merged) {
            let mut texels = Texels::of(scan, *merged)?;
            texels.first = first;
            first += texels.size[2] as u32;
            send(gpu, &texture, &texels);
            parts.push(texels);
        }
        let notes = scans
            .iter()
            .zip(&parts)
            .filter_map(downsampling_note)
            .collect();
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        return Ok((view, parts, notes));
    }
}

fn make(gpu: &Gpu, size: [usize; 3]) -> Result<wgpu::Texture> {
    gpu.volume_texture(
        "scans",
        size.map(|n| n as u32),
        wgpu::TextureFormat::R16Float,
        wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
    )
}

/// Returns the message for a downsampled scan.
fn downsampling_note((scan, texels): (&Scan, &Texels)) -> Option<String> {
    (texels.downsampling != [1; 3]).then(|| {
        let times = |n: [usize; 3]| n.map(|n| n.to_string()).join(" x ");
        format!(
            "a scan of {} voxels exceeds the device limits; rendering it with blocks of {} voxels merged, {} texels in total",
            times(scan.volume.size),
            times(texels.downsampling),
            times(texels.size)
        )
    })
}

fn send(gpu: &Gpu, texture: &wgpu::Texture, texels: &Texels) {
    let [nx, ny, nz] = texels.size;
    let layers = (UPLOAD_BYTES / (2 * nx * ny)).max(1);
    for z in (0..nz).step_by(layers) {
        let count = layers.min(nz - z);
        gpu.queue().write_texture(
            wgpu::TexelCopyTextureInfo {
                texture,
                mip_level: 0,
                origin: wgpu::Origin3d {
                    x: 0,
                    y: 0,
                    z: texels.first + z as u32,
                },
                aspect: wgpu::TextureAspect::All,
            },
            bytemuck::cast_slice(&texels.values[z * nx * ny..(z + count) * nx * ny]),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(2 * nx as u32),
                rows_per_image: Some(ny as u32),
            },
            wgpu::Extent3d {
                width: nx as u32,
                height: ny as u32,
                depth_or_array_layers: count as u32,
            },
        );
        // Submits now, since written data stays in memory until submission.
        gpu.submit([]);
    }
}
