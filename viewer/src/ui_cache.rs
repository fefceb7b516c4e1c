//! Caches the interface around the picture as an image and redraws only changed parts. On a
//! software driver the panels take longer to draw than the body.

use crate::blit::{Blit, ImageBorders};
use eframe::egui::epaint::ClippedShape;
use eframe::egui::{self, Pos2, Rect};
use eframe::egui_wgpu::{RenderState, ScreenDescriptor};

/// Number of frames until new glyphs are uploaded.
const FONT_UPLOAD_FRAMES: u32 = 3;
/// Margin of shapes beyond their bounds, in points, for antialiasing.
const ANTIALIAS_MARGIN: f32 = 1.5;

/// Cache of the interface around the picture.
pub(crate) struct UiCache {
    state: RenderState,
    /// Rectangle of the picture, if known.
    pub picture: Option<Rect>,
    blit: Blit,
    /// The cached image of the areas above, below, left and right of the picture.
    drawn: Option<CachedUiImage>,
    /// Remaining frames without caching.
    fresh: u32,
}

/// A cached image of the interface, and its shapes.
struct CachedUiImage {
    view: wgpu::TextureView,
    shown: wgpu::BindGroup,
    sides: [Rect; 4],
    scale: f32,
    shapes: [Vec<ClippedShape>; 4],
}

impl UiCache {
    /// Creates the cache for the interface's render target.
    pub fn new(state: &RenderState) -> UiCache {
        UiCache {
            blit: Blit::exact(state),
            state: state.clone(),
            picture: None,
            drawn: None,
            fresh: FONT_UPLOAD_FRAMES,
        }
    }

    /// Updates the cached image.
    fn draw(
        &mut self,
        context: &egui::Context,
        (size, scale): ([u32; 2], f32),
        sides: [Rect; 4],
        shapes: [Vec<ClippedShape>; 4],
    ) {
        let fits = |drawn: &CachedUiImage| {
            let texture = drawn.view.texture();
            (drawn.sides, drawn.scale) == (sides, scale)
                && [texture.width(), texture.height()] == size
        };
        let old = self.drawn.take().filter(fits);
        let anew = old.is_none();
        let mut drawn = old.unwrap_or_else(|| self.blank(size, scale, sides));
        let mut dirty = Vec::new();
        for ((side, before), now) in sides.iter().zip(&drawn.shapes).zip(&shapes) {
            let changed = match anew {
                true => *side,
                false => changed(before, now).intersect(*side),
            };
            if changed.is_positive() {
                let changed = whole_pixels(changed, scale);
                let touched = now.iter().filter(|s| bounds(s).intersects(changed));
                dirty.extend(touched.map(|s| ClippedShape {
                    clip_rect: s.clip_rect.intersect(changed),
                    ..s.clone()
                }));
            }
        }
        drawn.shapes = shapes;
        if anew || !dirty.is_empty() {
            let primitives = context.tessellate(dirty, scale);
            self.paint(&drawn.view, &primitives, (size, scale), anew);
        }
        self.drawn = Some(drawn);
    }

    fn blank(&self, size: [u32; 2], scale: f32, sides: [Rect; 4]) -> CachedUiImage {
        let texture = self.state.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("interface"),
            size: wgpu::Extent3d {
                width: size[0],
                height: size[1],
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: self.state.target_format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        CachedUiImage {
            shown: self.blit.bind_texture(&self.state.device, &view),
            view,
            sides,
            scale,
            shapes: Default::default(),
        }
    }

    fn paint(
        &self,
        view: &wgpu::TextureView,
        primitives: &[egui::ClippedPrimitive],
        (size_in_pixels, pixels_per_point): ([u32; 2], f32),
        anew: bool,
    ) {
        let (device, queue) = (&self.state.device, &self.state.queue);
        let screen = ScreenDescriptor {
            size_in_pixels,
            pixels_per_point,
        };
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut renderer = self.state.renderer.write();
        let mut work = renderer.update_buffers(device, queue, &mut encoder, primitives, &screen);
        {
            let load = match anew {
                true => wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                false => wgpu::LoadOp::Load,
            };
            let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("interface"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load,
                        store: wgpu::StoreOp::Store,
                    },
                    depth_slice: None,
                })],
                ..wgpu::RenderPassDescriptor::default()
            });
            renderer.render(&mut pass.forget_lifetime(), primitives, &screen);
        }
        work.push(encoder.finish());
        queue.submit(work);
    }
}

impl egui::Plugin for UiCache {
    fn debug_name(&self) -> &'static str {
        "kept"
    }

    fn output_hook(&mut self, context: &egui::Context, output: &mut egui::FullOutput) {
        let Some(picture) = self.picture.take() else {
            return;
        };
        self.fresh = match output.textures_delta.is_empty() {
            true => self.fresh.saturating_sub(1),
            // Cached glyphs may have moved in the font texture.
            false => FONT_UPLOAD_FRAMES,
        };
        if self.fresh > 0 {
            self.drawn = None;
            return;
        }
        let (screen, scale) = (context.viewport_rect(), output.pixels_per_point);
        let picture = nearest_pixels(picture, scale);
        let size = [screen.width(), screen.height()].map(|n| (n * scale).round() as u32);
        if size.contains(&0) || !screen.contains_rect(picture) {
            return;
        }
        let sides = around(screen, picture);
        let (kept, mut over) = parted(std::mem::take(&mut output.shapes), &sides, picture);
        self.draw(context, (size, scale), sides, kept);
        if let Some(drawn) = &self.drawn {
            let pixels = sides.map(|side| {
                [side.min, side.max]
                    .map(|p| [p.x, p.y].map(|n| (n * scale).round().max(0.0) as u32))
            });
            let shape = self
                .blit
                .border_shape(&drawn.shown, screen, ImageBorders(pixels));
            output.shapes.push(ClippedShape::new(screen, shape));
        }
        output.shapes.append(&mut over);
    }
}

/// Returns the areas above, below, left and right of a picture on a screen.
fn around(screen: Rect, picture: Rect) -> [Rect; 4] {
    let across = |left: f32, right: f32| {
        let corner = |x: f32, y: f32| Pos2::new(x, y);
        Rect::from_min_max(corner(left, picture.top()), corner(right, picture.bottom()))
    };
    let mut above = screen;
    above.set_bottom(picture.top());
    let mut below = screen;
    below.set_top(picture.bottom());
    [
        above,
        below,
        across(screen.left(), picture.left()),
        across(picture.right(), screen.right()),
    ]
}

/// Splits shapes into those within one side, per side, and all others in order: shapes over the
/// picture, over several sides, or on top of such shapes.
fn parted(
    shapes: Vec<ClippedShape>,
    sides: &[Rect; 4],
    picture: Rect,
) -> ([Vec<ClippedShape>; 4], Vec<ClippedShape>) {
    let (mut kept, mut over): ([Vec<ClippedShape>; 4], _) = (Default::default(), Vec::new());
    let mut covered: Vec<Rect> = Vec::new();
    for shape in shapes {
        let seen = bounds(&shape);
        if !seen.is_positive() {
            continue;
        }
        let hidden = covered.iter().any(|rect| rect.intersects(seen));
        let within = |side: &Rect| side.expand(ANTIALIAS_MARGIN).contains_rect(seen);
        match sides.iter().position(within).filter(|_| !hidden) {
            Some(side) => kept[side].push(shape),
            None => {
                if !picture.expand(ANTIALIAS_MARGIN).contains_rect(seen) {
                    covered.push(seen);
                }
                over.push(shape);
            }
        }
    }
    (kept, over)
}

/// Returns the visible bounds of a shape.
fn bounds(shape: &ClippedShape) -> Rect {
    let own = shape.shape.visual_bounding_rect();
    (shape.transform_after_tessellation * own).intersect(shape.clip_rect)
}

/// Returns the area in which two lists of shapes differ.
fn changed(before: &[ClippedShape], now: &[ClippedShape]) -> Rect {
    let same = |(a, b): &(&ClippedShape, &ClippedShape)| a == b;
    let first = before.iter().zip(now).take_while(same).count();
    let (before, now) = (&before[first..], &now[first..]);
    let last = before.iter().rev().zip(now.iter().rev());
    let last = last.take_while(same).count();
    let all = before[..before.len() - last]
        .iter()
        .chain(&now[..now.len() - last]);
    let all = all.fold(Rect::NOTHING, |rect, shape| rect.union(bounds(shape)));
    all.expand(ANTIALIAS_MARGIN)
}

/// Returns the rectangle rounded outwards to whole pixels, in points.
fn whole_pixels(rect: Rect, scale: f32) -> Rect {
    let [low, high] = [rect.min * scale, rect.max * scale];
    Rect::from_min_max(low.floor() / scale, high.ceil() / scale)
}

/// Returns the rectangle rounded to the nearest pixels, in points.
fn nearest_pixels(rect: Rect, scale: f32) -> Rect {
    let [low, high] = [rect.min * scale, rect.max * scale];
    Rect::from_min_max(low.round() / scale, high.round() / scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Color32, Shape, vec2};

    fn square(x: f32, y: f32, side: f32) -> ClippedShape {
        let rect = Rect::from_min_size(Pos2::new(x, y), vec2(side, side));
        ClippedShape::new(
            Rect::EVERYTHING,
            Shape::rect_filled(rect, 0.0, Color32::WHITE),
        )
    }

    fn screen() -> (Rect, Rect) {
        let screen = Rect::from_min_size(Pos2::ZERO, vec2(100.0, 80.0));
        (
            screen,
            Rect::from_min_max(Pos2::new(20.0, 10.0), Pos2::new(70.0, 60.0)),
        )
    }

    #[test]
    fn only_shapes_within_one_side_are_cached() {
        let (screen, picture) = screen();
        let sides = around(screen, picture);
        let shapes = vec![
            square(5.0, 2.0, 4.0),
            square(80.0, 20.0, 8.0),
            // Over the picture.
            square(30.0, 30.0, 5.0),
            // Over the picture and a side, and a shape on top of that one.
            square(60.0, 40.0, 30.0),
            square(82.0, 45.0, 3.0),
            // Beside the picture, below it.
            square(5.0, 65.0, 10.0),
        ];
        let (kept, over) = parted(shapes.clone(), &sides, picture);
        assert_eq!(kept[0], [shapes[0].clone()]);
        assert_eq!(kept[1], [shapes[5].clone()]);
        assert!(kept[2].is_empty());
        assert_eq!(kept[3], [shapes[1].clone()]);
        assert_eq!(over, shapes[2..5]);
    }

    #[test]
    fn only_changed_area_is_redrawn() {
        let before: Vec<ClippedShape> = (0..5).map(|n| square(10.0 * n as f32, 0.0, 5.0)).collect();
        assert!(!changed(&before, &before).is_positive());
        let mut now = before.clone();
        now[2] = square(20.0, 0.0, 6.0);
        let rect = changed(&before, &now);
        assert!(rect.contains_rect(bounds(&now[2])));
        assert!(!rect.intersects(bounds(&now[1])) && !rect.intersects(bounds(&now[3])));
        // A removed shape, and an added one.
        now = before.clone();
        now.remove(3);
        assert!(changed(&before, &now).contains_rect(bounds(&before[3])));
        assert!(changed(&now, &before).contains_rect(bounds(&before[3])));
        assert!(!changed(&now, &before).intersects(bounds(&before[1])));
    }
}
