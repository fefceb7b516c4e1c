//! Appearance of a skin: colours, opacity, normal and height maps.

use super::draw::Skin;
use super::map::Map;
use crate::gpu::Texel;
use crate::mesh::{Field, Location};
use crate::render::TransferFunction;
use crate::{Error, Result};

/// Colour source of a skin.
#[derive(Clone, Debug, PartialEq)]
pub enum SkinColouring {
    /// One RGB colour.
    Plain([f32; 3]),
    /// A scalar field on the vertices, coloured by a transfer function.
    Field {
        /// Name of the scalar field.
        name: String,
        /// Transfer function; a relative one is scaled to the range of the field.
        transfer: TransferFunction,
    },
}

impl Skin {
    /// Returns the opacity α, 0 < α ≤ 1.
    pub fn opacity(&self) -> f32 {
        self.opacity
    }

    /// Sets the vertex colours.
    ///
    /// # Errors
    /// [`Error::Input`] if the surface has no such scalar on its vertices, or a value is not
    /// finite.
    pub fn set_colour(&mut self, colour: &SkinColouring) -> Result<()> {
        let colours: Vec<[f32; 4]> = match colour {
            SkinColouring::Plain([r, g, b]) => vec![[*r, *g, *b, 1.0]; self.bound.len()],
            SkinColouring::Field { name, transfer } => {
                let values = self.scalar(name)?;
                let ends = values
                    .iter()
                    .fold((f64::MAX, f64::MIN), |(a, b), s| (a.min(*s), b.max(*s)));
                let resolved = transfer.to_absolute(ends, self.carrier.frame.scale);
                let of = |v: &u32| {
                    let [r, g, b] = resolved.colour(values[*v as usize]).map(|c| c as f32);
                    [r, g, b, 1.0]
                };
                self.vertices.sources.iter().map(of).collect()
            }
        };
        self.upload_colours(&colours)
    }

    /// Sets the colours of the vertices of its surface.
    pub(crate) fn set_vertex_colours(&mut self, colours: &[[f32; 3]]) -> Result<()> {
        let of = |v: &u32| {
            let [r, g, b] = colours[*v as usize];
            [r, g, b, 1.0]
        };
        let colours: Vec<[f32; 4]> = self.vertices.sources.iter().map(of).collect();
        self.upload_colours(&colours)
    }

    fn upload_colours(&mut self, colours: &[[f32; 4]]) -> Result<()> {
        // A new array, because images that are recorded but not yet submitted still use the old
        // one.
        self.colours = self.gpu.array_of("skin colours", Texel::F32x4, colours)?;
        self.draws.clear();
        Ok(())
    }

    fn scalar(&self, name: &str) -> Result<&[f64]> {
        let at_vertices = |f: &&Field| {
            f.location == Location::Node
                && f.components == 1
                && f.values.len() == self.report.vertices
        };
        let known: Vec<_> = self.scalars.iter().filter(at_vertices).collect();
        let found = known.iter().find(|f| f.name == name);
        match found {
            Some(f) if f.values.iter().all(|s| s.is_finite()) => Ok(&f.values),
            Some(_) => Err(Error::Input(format!(
                "scalar \"{name}\" of the skin has non-finite values; values must be finite"
            ))),
            None => Err(Error::Input(format!(
                "the skin has no vertex scalar \"{name}\"; available: {}",
                known
                    .iter()
                    .map(|f| f.name.as_str())
                    .collect::<Vec<_>>()
                    .join(", ")
            ))),
        }
    }

    /// Sets the opacity α: the skin absorbs this fraction of the light.
    ///
    /// # Errors
    /// [`Error::Input`] unless 0 < opacity ≤ 1.
    pub fn set_opacity(&mut self, opacity: f32) -> Result<()> {
        if !(opacity > 0.0 && opacity <= 1.0) {
            return Err(Error::Input(format!(
                "skin opacity must be > 0 and ≤ 1, got {opacity}"
            )));
        }
        self.opacity = opacity;
        Ok(())
    }

    /// Sets or removes the tangent-space normal map.
    ///
    /// # Errors
    /// [`Error::Input`] if the surface has no texture coordinates, or the map no texels.
    pub fn set_normal_map(&mut self, map: Option<&Map>) -> Result<()> {
        self.normal_map = match map {
            None => None,
            Some(map) => Some(self.upload(map)?),
        };
        self.draws.clear();
        Ok(())
    }

    /// Sets or removes the height map (parallax mapping). `relief` is the depth of the value 0, in
    /// texture units.
    ///
    /// # Errors
    /// As [`Skin::set_normal_map`]; also if the relief is negative or not finite.
    pub fn set_height_map(&mut self, map: Option<(&Map, f32)>) -> Result<()> {
        self.height_map = match map {
            None => None,
            Some((_, relief)) if !(relief >= 0.0 && relief.is_finite()) => {
                return Err(Error::Input(format!(
                    "relief must be finite and ≥ 0 (texture units), got {relief}"
                )));
            }
            Some((map, relief)) => Some((self.upload(map)?, relief)),
        };
        self.draws.clear();
        Ok(())
    }

    fn upload(&self, map: &Map) -> Result<wgpu::TextureView> {
        if self.vertices.uvs.is_empty() {
            return Err(Error::Input(
                "the skin has no texture coordinates, which maps need; use an OBJ file with texture coordinates"
                    .into(),
            ));
        }
        map.upload(&self.gpu)
    }
}
