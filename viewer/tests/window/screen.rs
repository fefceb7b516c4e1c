//! A window on a virtual screen, driven by real events and observed through its frame log.

use palpate::render::{Background, BitDepth, Image, ImageDifference};
use serde_json::Value;
use std::cell::{RefCell, RefMut};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

const SIZE: [usize; 2] = [1024, 768];
/// Height of the status bar, whose times and rates vary, in pixels.
const STATUS: usize = 26;
/// Maximum root mean square difference of matching images (range 0 to 1).
const ALIKE: f64 = 0.012;
/// Polling interval of the log.
const LOOK: Duration = Duration::from_millis(20);
/// A guard against hangs.
const PATIENCE: Duration = Duration::from_secs(600);
/// Maximum number of steps until a body comes to rest.
const MAX_STEPS: u64 = 3000;

/// Held by the only window: concurrent windows would distort each other's timings.
static ALONE: Mutex<()> = Mutex::new(());

/// Content of the window's log.
#[derive(Default)]
struct Log {
    /// Number of bytes read.
    read: u64,
    frames: Vec<Value>,
    /// The last frame that was presented.
    presented: Value,
    /// The last record with the live allocations on the device and their bytes.
    device: Value,
}

/// A virtual screen with the window.
pub struct Window {
    _alone: MutexGuard<'static, ()>,
    screen: Child,
    viewer: Child,
    display: String,
    log: RefCell<Log>,
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
        "cannot run {program}: {e}; install it with `scripts/test viewer` (on Debian: apt install xvfb xdotool)"
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
            log: RefCell::default(),
            folder,
        };
        window.wait("the body", |frame| frame["tets"].as_u64() > Some(0));
        window.rest();
        let found = window.xdotool(&["search", "--name", "Palpate"]);
        let id = found
            .lines()
            .last()
            .expect("xdotool finds no window named Palpate")
            .to_owned();
        window.xdotool(&["windowfocus", &id]);
        window
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

    /// Reads new lines of the log.
    fn read_log(&self) -> RefMut<'_, Log> {
        let mut log = self.log.borrow_mut();
        let mut text = String::new();
        if let Ok(mut file) = File::open(self.folder.path().join("log.jsonl")) {
            file.seek(SeekFrom::Start(log.read)).unwrap();
            file.read_to_string(&mut text).unwrap();
        }
        // The last line may be incomplete.
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        log.read += whole as u64;
        for line in text[..whole].lines() {
            let line: Value = serde_json::from_str(line).unwrap();
            if line.get("number").is_some() {
                log.frames.push(line);
            } else {
                if !line["device_bytes"].is_null() {
                    log.device = line.clone();
                }
                log.presented = line;
            }
        }
        log
    }

    /// Returns all frames so far.
    pub fn frames(&self) -> Vec<Value> {
        self.read_log().frames.clone()
    }

    pub fn last(&self) -> Value {
        self.read_log().frames.last().cloned().unwrap_or_default()
    }

    /// Returns the number of live allocations on the device and their bytes at the last rest; `None`
    /// if the driver does not report them.
    pub fn device_memory(&self) -> Option<[u64; 2]> {
        let log = self.read_log();
        let number = |key: &str| log.device[key].as_u64();
        Some([number("allocations")?, number("device_bytes")?])
    }

    /// Returns the first frame of the log that satisfies `is`.
    pub fn logged(&self, is: impl Fn(&Value) -> bool) -> Option<Value> {
        let log = self.read_log();
        log.frames.iter().find(|frame| is(frame)).cloned()
    }

    /// Waits for a frame that satisfies `is`: the last one or a later one.
    pub fn wait(&mut self, what: &str, is: impl Fn(&Value) -> bool) -> Value {
        let since = Instant::now();
        let mut next = self.read_log().frames.len().saturating_sub(1);
        loop {
            if let Some(status) = self.viewer.try_wait().unwrap() {
                panic!("the viewer ended: {status}");
            }
            let log = self.read_log();
            if let Some(frame) = log.frames[next..].iter().find(|frame| is(frame)) {
                return frame.clone();
            }
            next = log.frames.len();
            let waited = since.elapsed();
            assert!(
                waited < PATIENCE,
                "timed out waiting for {what}: {:?}",
                log.frames.last()
            );
            drop(log);
            std::thread::sleep(LOOK);
        }
    }

    /// Waits until no work is pending, the last frame is presented and no other frame is requested.
    pub fn rest(&mut self) {
        let since = Instant::now();
        let steps = |frame: &Value| frame["steps"].as_u64().unwrap_or(0);
        let first = steps(&self.last());
        loop {
            if let Some(status) = self.viewer.try_wait().unwrap() {
                panic!("the viewer ended: {status}");
            }
            let log = self.read_log();
            if let Some(last) = log.frames.last() {
                let presented = log.presented["presented"] == last["number"];
                if last["busy"] == false && presented && log.presented["soon"] == false {
                    return;
                }
                // Opening a body resets the number of steps.
                let done = steps(last).saturating_sub(first);
                assert!(
                    done < MAX_STEPS,
                    "the body does not come to rest within {MAX_STEPS} steps: {last}"
                );
            }
            assert!(
                since.elapsed() < PATIENCE,
                "the window does not come to rest within {PATIENCE:?}"
            );
            drop(log);
            std::thread::sleep(LOOK);
        }
    }

    /// Presses a key and waits until the window has received it.
    pub fn key(&mut self, name: &str) {
        let keys = self.last()["keys"].as_u64();
        self.xdotool(&["key", name]);
        self.wait("the key", |frame| frame["keys"].as_u64() > keys);
    }

    /// Opens the prompt for a path by a key, replaces its text by `path` and confirms it. The prompt
    /// takes keys once it has been drawn.
    pub fn enter_path(&mut self, key: &str, path: &str) {
        self.key(key);
        self.rest();
        self.key("ctrl+a");
        self.rest();
        self.xdotool(&["type", "--delay", "20", path]);
        self.key("Return");
    }

    pub fn click(&mut self, at: [i32; 2]) {
        self.to(at);
        self.button(true);
        self.button(false);
    }

    /// Moves the pointer and waits until the window has received its position.
    pub fn to(&mut self, at: [i32; 2]) {
        let [x, y] = at.map(|n| n.to_string());
        self.xdotool(&["mousemove", &x, &y]);
        self.wait("the pointer", |frame| {
            let there = |k: usize| frame["pointer"][k].as_f64() == Some(f64::from(at[k]));
            there(0) && there(1)
        });
    }

    /// Presses or releases the left button and waits until the window has received it.
    pub fn button(&mut self, down: bool) {
        self.xdotool(&[if down { "mousedown" } else { "mouseup" }, "1"]);
        self.wait("the button", |frame| frame["down"] == down);
    }

    /// Presses the left button at `from` and drags to `to` without releasing it.
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

    /// Returns a screenshot at rest, once two in a row agree: X may still be copying a frame.
    pub fn shot(&self) -> Image {
        let mut before = self.pixels();
        loop {
            // X answers once it has processed earlier requests.
            self.xdotool(&["getmouselocation"]);
            let now = self.pixels();
            if now.values == before.values {
                return now;
            }
            before = now;
        }
    }

    /// Waits until `is` holds for a screenshot.
    pub fn wait_for_pixels(&self, is: impl Fn(&Image) -> bool) {
        let began = Instant::now();
        while !is(&self.shot()) {
            assert!(began.elapsed() < PATIENCE, "the picture did not come");
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Reads the screen memory of Xvfb, a file in XWD format.
    pub fn pixels(&self) -> Image {
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

    /// Compares the screen with the golden image of this name.
    pub fn hold_against(&mut self, name: &str) -> Image {
        // Keep the pointer and its tooltips out of the comparison.
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
            panic!(
                "{name}: {apart:?} from its golden, at most {ALIKE}; see {}",
                kept.display()
            );
        }
        shot
    }
}

fn golden(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    folder.join(format!("{name}.png"))
}
