//! A window on a screen of its own, used by real events; what it does is told by its log.

use palpate::render::{Background, BitDepth, Image, ImageDifference};
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

const SIZE: [usize; 2] = [1024, 768];
/// Of the lower edge, where times and rates are told.
const STATUS: usize = 26;
/// Root mean square difference of what is alike, of 1.
const ALIKE: f64 = 0.012;
/// For so long no frame is drawn at rest.
const QUIET: Duration = Duration::from_millis(400);
/// How often the log is looked at, and for how long something may take on a machine that is busy.
const LOOK: Duration = Duration::from_millis(20);
const PATIENCE: Duration = Duration::from_secs(600);

/// Whose window it is: beside another, that one's time would be measured too.
static ALONE: Mutex<()> = Mutex::new(());

/// A screen with a window on it, the only one there is.
pub struct Window {
    _alone: MutexGuard<'static, ()>,
    screen: Child,
    viewer: Child,
    display: String,
    pub folder: tempfile::TempDir,
}

impl Drop for Window {
    fn drop(&mut self) {
        for child in [&mut self.viewer, &mut self.screen] {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn missing(program: &str, e: std::io::Error) -> ! {
    panic!(
        "{program}: {e}; `scripts/test viewer` installs it (on Debian: apt install xvfb xdotool)"
    )
}

impl Window {
    pub fn open(arguments: &[&str]) -> Window {
        let alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = tempfile::tempdir().unwrap();
        let [width, height] = SIZE;
        let mut screen = Command::new("Xvfb")
            .args(["-displayfd", "1", "-nolisten", "tcp", "-fbdir"])
            .arg(folder.path())
            .args(["-screen", "0", &format!("{width}x{height}x24")])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap_or_else(|e| missing("Xvfb", e));
        let mut number = String::new();
        let mut out = BufReader::new(screen.stdout.take().unwrap());
        out.read_line(&mut number).unwrap();
        let display = format!(":{}", number.trim());
        let viewer = Command::new(env!("CARGO_BIN_EXE_palpate-view"))
            .args(arguments)
            .args(["--size", &format!("{width}x{height}"), "--log"])
            .arg(folder.path().join("log.jsonl"))
            .env("DISPLAY", &display)
            .env_remove("WAYLAND_DISPLAY")
            .env("PALPATE_VIEW_SETTINGS", folder.path().join("settings.json"))
            .current_dir(folder.path())
            .spawn()
            .unwrap();
        let mut window = Window {
            _alone: alone,
            screen,
            viewer,
            display,
            folder,
        };
        window.wait("the body", |frame| frame["tets"].as_u64() > Some(0));
        window.rest();
        let found = window.xdotool(&["search", "--name", "Palpate"]);
        let id = found.lines().last().expect("no window").to_owned();
        window.xdotool(&["windowfocus", &id]);
        window
    }

    /// The number of its process.
    pub fn process(&self) -> u32 {
        self.viewer.id()
    }

    pub fn xdotool(&self, arguments: &[&str]) -> String {
        let done = Command::new("xdotool")
            .args(arguments)
            .env("DISPLAY", &self.display)
            .output()
            .unwrap_or_else(|e| missing("xdotool", e));
        assert!(done.status.success(), "xdotool {arguments:?}: {done:?}");
        String::from_utf8(done.stdout).unwrap()
    }

    /// Frames so far.
    pub fn frames(&self) -> Vec<Value> {
        let text = std::fs::read_to_string(self.folder.path().join("log.jsonl"));
        let text = text.unwrap_or_default();
        // The last line may be half there.
        let lines = text.lines().map(serde_json::from_str);
        lines.map_while(Result::ok).collect()
    }

    pub fn last(&self) -> Value {
        self.frames().pop().unwrap_or_default()
    }

    /// Waits until a frame is as it should be.
    pub fn wait(&mut self, what: &str, is: impl Fn(&Value) -> bool) -> Value {
        let since = Instant::now();
        loop {
            if let Some(status) = self.viewer.try_wait().unwrap() {
                panic!("the viewer ended: {status}");
            }
            let frame = self.last();
            if is(&frame) {
                return frame;
            }
            let waited = since.elapsed();
            assert!(waited < PATIENCE, "no sign of {what}: {frame}");
            std::thread::sleep(LOOK);
        }
    }

    /// Waits until nothing moves, and nothing is drawn any more.
    pub fn rest(&mut self) {
        let mut before = (0, Instant::now());
        let since = Instant::now();
        loop {
            let frames = self.frames();
            if frames.len() != before.0 {
                before = (frames.len(), Instant::now());
            }
            let busy = frames.last().is_none_or(|frame| frame["busy"] == true);
            if !busy && before.1.elapsed() >= QUIET {
                return;
            }
            assert!(since.elapsed() < PATIENCE, "it never rests");
            std::thread::sleep(LOOK);
        }
    }

    /// Hits a key, and waits until the window has taken it.
    pub fn key(&mut self, name: &str) {
        let keys = self.last()["keys"].as_u64();
        self.xdotool(&["key", name]);
        self.wait("the key", |frame| frame["keys"].as_u64() > keys);
    }

    pub fn click(&mut self, at: [i32; 2]) {
        self.to(at);
        self.button(true);
        self.button(false);
    }

    /// Moves the pointer, and waits until the window has seen it there.
    pub fn to(&mut self, at: [i32; 2]) {
        let [x, y] = at.map(|n| n.to_string());
        self.xdotool(&["mousemove", &x, &y]);
        self.wait("the pointer", |frame| {
            let there = |k: usize| frame["pointer"][k].as_f64() == Some(f64::from(at[k]));
            there(0) && there(1)
        });
    }

    /// Presses the left button, or lets it go, and waits until the window has seen it.
    pub fn button(&mut self, down: bool) {
        self.xdotool(&[if down { "mousedown" } else { "mouseup" }, "1"]);
        self.wait("the button", |frame| frame["down"] == down);
    }

    /// Presses the left button at a place and moves it to another, where it stays down.
    pub fn hold(&mut self, from: [i32; 2], to: [i32; 2]) {
        self.to(from);
        self.button(true);
        for n in 1..=12 {
            self.to([0, 1].map(|k| from[k] + (to[k] - from[k]) * n / 12));
        }
    }

    pub fn let_go(&mut self) {
        self.button(false);
        self.rest();
    }

    /// What is on the screen: the memory of Xvfb, which is a file in the format XWD.
    pub fn shot(&self) -> Image {
        let bytes = std::fs::read(self.folder.path().join("Xvfb_screen0")).unwrap();
        let word =
            |n: usize| u32::from_be_bytes(bytes[4 * n..4 * n + 4].try_into().unwrap()) as usize;
        assert_eq!((word(4), word(5), word(11)), (SIZE[0], SIZE[1], 32));
        let (start, line) = (word(0) + 12 * word(19), word(12));
        let mut values = Vec::new();
        for y in 0..SIZE[1] - STATUS {
            for x in 0..SIZE[0] {
                let at = start + y * line + 4 * x;
                let [b, g, r] = [0, 1, 2].map(|k| f32::from(bytes[at + k]) / 255.0);
                values.extend([r, g, b, 1.0]);
            }
        }
        Image {
            size: [SIZE[0] as u32, (SIZE[1] - STATUS) as u32],
            channels: 4,
            values,
        }
    }

    /// Holds what is on the screen against the golden of this name.
    pub fn hold_against(&mut self, name: &str) -> Image {
        // Not the pointer, nor what hangs on it.
        self.to([4, 700]);
        self.rest();
        let shot = self.shot();
        let golden = golden(name);
        if std::env::var_os("PALPATE_BLESS").is_some() {
            shot.save_as(&golden, Background::Black, BitDepth::Eight)
                .unwrap();
            return shot;
        }
        let apart =
            ImageDifference::between(&Image::read_for_comparison(&golden).unwrap(), &shot).unwrap();
        if apart.rmse > ALIKE {
            let kept = std::env::temp_dir().join(format!("palpate-view-{name}.png"));
            shot.save_as(&kept, Background::Black, BitDepth::Eight)
                .unwrap();
            panic!("{name}: {apart:?} from its golden; see {}", kept.display());
        }
        shot
    }
}

fn golden(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    folder.join(format!("{name}.png"))
}
