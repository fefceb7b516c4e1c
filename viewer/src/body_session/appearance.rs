//! Appearance of the body, with the scans and skins read so far.

use super::BodySession;
use crate::loading::ReadScan;
use palpate::Result;
use palpate::scene::{Scene, SkinEntry};
use std::path::Path;

impl BodySession {
    /// Applies the appearance of `scene`; updates `notes`.
    ///
    /// # Errors
    /// As [`Stage::set_appearance`](palpate::scene::Stage::set_appearance).
    pub fn set_appearance(&mut self, scene: &Scene) -> Result<()> {
        self.version += 1;
        let scene = self.with_read(scene);
        self.notes = self.stage.set_appearance(&scene)?;
        self.use_series_range(&scene)
    }

    /// Sets the scalar range to that of all frames of a recorded series.
    pub(crate) fn use_series_range(&mut self, scene: &Scene) -> Result<()> {
        if let Some(wider) = self.with_series_range(scene) {
            self.notes = self.stage.set_appearance(&wider)?;
        }
        Ok(())
    }

    /// Returns the scene with the scans and skins read so far.
    fn with_read(&self, scene: &Scene) -> Scene {
        let mut scene = scene.clone();
        for scan in &mut scene.scan {
            let mut all = self.read.0.iter().map(|(known, _)| known);
            let known = all.find(|known| known.file == scan.file);
            if let Some(known) = known.filter(|_| scan.volume.0.is_none()) {
                scan.volume = known.volume.clone();
            }
        }
        for skin in &mut scene.skin {
            let same = |k: &&SkinEntry| {
                let (a, b) = (
                    (&k.file, k.smooth, &k.labels),
                    (&skin.file, skin.smooth, &skin.labels),
                );
                a == b && k.above == skin.above
            };
            let known = self.read.1.iter().find(same).map(|k| k.surface.clone());
            if let Some(known) = known.filter(|_| skin.surface.0.is_none()) {
                skin.surface = known;
            }
        }
        scene
    }

    /// Returns the labels of a scan that was read, by number and name, if they are few.
    pub(crate) fn labels_of(&self, file: &Path) -> Option<&[(i64, String)]> {
        let known = self.read.0.iter().find(|(scan, _)| scan.file == file)?;
        known.1.as_deref()
    }

    /// Caches scans and skins, so that edits need not read them again.
    pub(crate) fn keep_read(&mut self, scans: Vec<ReadScan>, skins: Vec<SkinEntry>) {
        for scan in scans {
            self.read.0.retain(|known| known.0.file != scan.0.file);
            self.read.0.push(scan);
        }
        self.read.1.extend(skins);
    }

    /// Applies planes and isosurfaces only.
    ///
    /// # Errors
    /// As [`Stage::set_planes`](palpate::scene::Stage::set_planes).
    pub fn set_planes(&mut self, scene: &Scene) -> Result<()> {
        self.version += 1;
        self.notes = self.stage.set_planes(scene)?;
        Ok(())
    }
}
