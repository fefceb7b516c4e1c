//! What is remembered from one time to the next.

use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Files that are remembered.
const RECENT: usize = 10;

/// Which buttons of the mouse do what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Habit {
    /// As ParaView has it: left goes round, middle moves, right comes nearer; with Shift left rolls.
    #[default]
    ParaView,
    /// As 3D Slicer has it: left goes round, middle or Shift and left move, right comes nearer; with
    /// Ctrl left rolls.
    Slicer,
}

/// Whether the interface is dark or light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub enum Theme {
    System,
    #[default]
    Dark,
    Light,
}

/// What is remembered.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Settings {
    /// Which buttons of the mouse do what.
    pub habit: Habit,
    /// Dark or light.
    pub theme: Theme,
    /// Files that were opened, the last one first.
    pub recent: Vec<PathBuf>,
    #[serde(skip)]
    file: Option<PathBuf>,
}

impl Settings {
    /// Those that were written last; the usual ones where there are none, or none that can be read.
    pub fn read() -> Settings {
        let Some(file) = place() else {
            return Settings::default();
        };
        let text = std::fs::read_to_string(&file).unwrap_or_default();
        Settings {
            file: Some(file),
            ..serde_json::from_str(&text).unwrap_or_default()
        }
    }

    /// Writes them. Where that cannot be, nothing is remembered.
    pub fn write(&self) {
        let Some(file) = &self.file else { return };
        let folder = file.parent().unwrap_or(Path::new("."));
        if std::fs::create_dir_all(folder).is_ok()
            && let Ok(text) = serde_json::to_string_pretty(self)
        {
            // Losing them is no reason to trouble anybody.
            let _ = palpate::io::atomic_write(file, |out| {
                use std::io::Write;
                out.write_all(text.as_bytes())
                    .map_err(palpate::Error::io(file))
            });
        }
    }

    /// Puts a file that was opened first.
    pub fn opened(&mut self, file: &Path) {
        self.recent.retain(|other| other != file);
        self.recent.insert(0, file.to_path_buf());
        self.recent.truncate(RECENT);
        self.write();
    }
}

/// Where they are kept: `PALPATE_VIEW_SETTINGS`, or a file in the folder that the system has for such.
fn place() -> Option<PathBuf> {
    let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty());
    if let Some(file) = variable("PALPATE_VIEW_SETTINGS") {
        return Some(file.into());
    }
    let folder = match std::env::consts::OS {
        "windows" => PathBuf::from(variable("APPDATA")?),
        "macos" => PathBuf::from(variable("HOME")?).join("Library/Application Support"),
        _ => match variable("XDG_CONFIG_HOME") {
            Some(folder) => folder.into(),
            None => PathBuf::from(variable("HOME")?).join(".config"),
        },
    };
    Some(folder.join("palpate").join("view.json"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn they_are_read_as_they_were_written_and_old_ones_too() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("a/view.json");
        let mut settings = Settings {
            habit: Habit::Slicer,
            file: Some(file.clone()),
            ..Settings::default()
        };
        for name in ["a.vtu", "b.vtu", "a.vtu"] {
            settings.opened(Path::new(name));
        }
        assert_eq!(settings.recent, [Path::new("a.vtu"), Path::new("b.vtu")]);
        let text = std::fs::read_to_string(&file).unwrap();
        let read: Settings = serde_json::from_str(&text).unwrap();
        assert_eq!(
            Settings {
                file: Some(file),
                ..read
            },
            settings
        );
        let old: Settings = serde_json::from_str(r#"{"theme": "Light"}"#).unwrap();
        assert_eq!((old.theme, old.habit), (Theme::Light, Habit::ParaView));
    }
}
