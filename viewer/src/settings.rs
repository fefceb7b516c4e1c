//! Persistent settings.

use crate::platform;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Maximum number of recent files.
const RECENT: usize = 10;

/// Mouse button bindings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum MouseBindings {
    /// ParaView: left orbits, middle pans, right zooms; Shift and left rolls, Ctrl and left zooms.
    #[default]
    ParaView,
    /// 3D Slicer: left orbits, middle or Shift and left pans, right zooms; Ctrl and left rolls.
    Slicer,
}

/// Theme of the interface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub enum Theme {
    System,
    #[default]
    Dark,
    Light,
}

/// Where the section through a press is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum SectionPlace {
    /// Nowhere.
    Hidden,
    /// At the lower right of the picture.
    #[default]
    Inset,
    /// In place of the picture.
    Large,
}

impl SectionPlace {
    /// Returns the next place, in turn.
    pub fn next(self) -> SectionPlace {
        match self {
            SectionPlace::Hidden => SectionPlace::Inset,
            SectionPlace::Inset => SectionPlace::Large,
            SectionPlace::Large => SectionPlace::Hidden,
        }
    }
}

/// Isolines on the section through a press.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub enum SectionLines {
    #[default]
    None,
    Displacement,
    Stress,
}

/// Persistent settings.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Settings {
    /// Mouse button bindings.
    #[serde(rename = "habit")]
    pub mouse_bindings: MouseBindings,
    /// Theme.
    pub theme: Theme,
    /// Where the section through a press is shown.
    pub section: SectionPlace,
    /// The isolines on it.
    pub section_lines: SectionLines,
    /// Recent files, the latest first.
    pub recent: Vec<PathBuf>,
}

impl Settings {
    /// Reads the stored settings. Invalid values become defaults; the others are kept.
    pub fn read() -> Settings {
        Settings::of(&platform::stored_settings().unwrap_or_default())
    }

    fn of(text: &str) -> Settings {
        let mut settings = Settings::default();
        let all: serde_json::Value = serde_json::from_str(text).unwrap_or_default();
        let one = |key: &str| all.get(key).cloned().unwrap_or_default();
        settings.mouse_bindings = serde_json::from_value(one("habit")).unwrap_or_default();
        settings.theme = serde_json::from_value(one("theme")).unwrap_or_default();
        settings.section = serde_json::from_value(one("section")).unwrap_or_default();
        settings.section_lines = serde_json::from_value(one("section_lines")).unwrap_or_default();
        settings.recent = serde_json::from_value(one("recent")).unwrap_or_default();
        settings
    }

    /// Stores the settings.
    pub fn write(&self) {
        if let Ok(text) = serde_json::to_string_pretty(self) {
            platform::store_settings(&text);
        }
    }

    /// Adds an opened file as the most recent.
    pub fn opened(&mut self, file: &Path) {
        self.note(file);
        self.write();
    }

    fn note(&mut self, file: &Path) {
        self.recent.retain(|other| other != file);
        self.recent.insert(0, file.to_path_buf());
        self.recent.truncate(RECENT);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn settings_round_trip_and_old_or_invalid_ones_load() {
        let mut settings = Settings {
            mouse_bindings: MouseBindings::Slicer,
            section: SectionPlace::Large,
            section_lines: SectionLines::Stress,
            ..Settings::default()
        };
        for name in ["a.vtu", "b.vtu", "a.vtu"] {
            settings.note(Path::new(name));
        }
        assert_eq!(settings.recent, [Path::new("a.vtu"), Path::new("b.vtu")]);
        let text = serde_json::to_string_pretty(&settings).unwrap();
        assert_eq!(Settings::of(&text), settings);
        let old = Settings::of(r#"{"theme": "Light"}"#);
        assert_eq!(
            (old.theme, old.mouse_bindings),
            (Theme::Light, MouseBindings::ParaView)
        );
        // An unknown value does not affect the others.
        let newer = Settings::of(r#"{"theme": "Sepia", "habit": "Slicer", "recent": ["a"]}"#);
        assert_eq!(
            (newer.theme, newer.mouse_bindings),
            (Theme::Dark, MouseBindings::Slicer)
        );
        assert_eq!(newer.recent, [Path::new("a")]);
        assert_eq!(Settings::of("nonsense"), Settings::default());
    }
}
