//! The graphics device, created by this crate or by the caller.

use super::pass::Pipelines;
use super::timing::Timer;
use crate::{Error, Result};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use web_time::{Duration, Instant};

/// Features used if the adapter has them; each has a fallback.
const OPTIONAL_FEATURES: wgpu::Features =
    wgpu::Features::TIMESTAMP_QUERY.union(wgpu::Features::FLOAT32_FILTERABLE);

/// A graphics device with its caches and counters. Clones share the device.
#[derive(Clone, Debug)]
pub struct Gpu {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    device: wgpu::Device,
    queue: wgpu::Queue,
    adapter: wgpu::AdapterInfo,
    pipelines: Pipelines,
    timer: Timer,
    readbacks: AtomicU64,
    bytes_made: AtomicU64,
    /// Number of recordings of each pass.
    recorded: Mutex<BTreeMap<String, u64>>,
    /// First asynchronous error; a lost device is permanent.
    trouble: Arc<Mutex<Option<DeviceFault>>>,
}

thread_local! {
    static SUBMITTING: Cell<Duration> = const { Cell::new(Duration::ZERO) };
}

/// Storage textures that the shader of light paths reads.
pub(crate) const MOST_STORAGE_TEXTURES: u32 = 8;

/// Returns WebGPU's default limits; on a software driver, which reads storage textures faster than
/// sampled ones, with more of these.
fn limits(adapter: &wgpu::Adapter, device_type: wgpu::DeviceType) -> wgpu::Limits {
    let mut limits = wgpu::Limits::default();
    if device_type == wgpu::DeviceType::Cpu {
        let own = adapter.limits().max_storage_textures_per_shader_stage;
        let most = &mut limits.max_storage_textures_per_shader_stage;
        *most = own.clamp(*most, MOST_STORAGE_TEXTURES);
    }
    limits
}

impl Gpu {
    /// Environment variable that selects the adapter: part of its name, its index in the list that
    /// the error shows, or `cpu` for a software adapter.
    pub const ADAPTER_VARIABLE: &str = "PALPATE_ADAPTER";

    /// Returns the total time that the calling thread has spent in queue submissions: microseconds
    /// each, except with software drivers, which may render during the submission.
    pub fn submit_time() -> Duration {
        SUBMITTING.get()
    }
}

#[derive(Clone, Debug)]
enum DeviceFault {
    Lost(String),
    Refused(String),
}

impl Gpu {
    /// Creates a device on the adapter selected by `PALPATE_ADAPTER`, by default on the most
    /// capable one.
    ///
    /// # Errors
    /// [`Error::NoAdapter`] with a hint what to install or a list of the adapters.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn new() -> Result<Gpu> {
        let wanted = std::env::var(Gpu::ADAPTER_VARIABLE).ok();
        Gpu::with_adapter(wanted.as_deref())
    }

    /// Creates a device on the adapter `wanted`: part of its name, case-insensitive, its index, or
    /// `cpu`; `None` selects the most capable one (discrete before integrated before software).
    ///
    /// # Errors
    /// As [`Gpu::new`].
    #[cfg(not(target_arch = "wasm32"))]
    pub fn with_adapter(wanted: Option<&str>) -> Result<Gpu> {
        let adapters = enumerate();
        pollster::block_on(Gpu::request(choose(&adapters, wanted)?))
    }

    /// Creates a device on `adapter` without blocking, as required in a browser.
    ///
    /// # Errors
    /// [`Error::NoAdapter`] if the adapter refuses it.
    pub async fn request(adapter: &wgpu::Adapter) -> Result<Gpu> {
        let info = adapter.get_info();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("palpate"),
            required_features: adapter.features() & OPTIONAL_FEATURES,
            required_limits: limits(adapter, info.device_type),
            ..Default::default()
        };
        let (device, queue) = adapter.request_device(&descriptor).await.map_err(|e| {
            Error::NoAdapter(format!(
                "{} ({:?}) cannot create a device with WebGPU's default limits: {e}; choose \
                another adapter with {} or --adapter",
                info.name,
                info.backend,
                Gpu::ADAPTER_VARIABLE
            ))
        })?;
        let gpu = Gpu::from_parts(info, device, queue);
        let trouble = gpu.inner.trouble.clone();
        gpu.device()
            .set_device_lost_callback(move |reason, message| {
                // Also called when a device is dropped, after the last reference to it.
                let why = match reason {
                    wgpu::DeviceLostReason::Destroyed if message.is_empty() => "destroyed".into(),
                    _ => message,
                };
                record_fault(&trouble, DeviceFault::Lost(why));
            });
        let trouble = gpu.inner.trouble.clone();
        gpu.device()
            .on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
                record_fault(&trouble, DeviceFault::Refused(error.to_string()));
            }));
        Ok(gpu)
    }

    /// Uses the caller's device: arrays and pipelines are created there, and passes can be recorded
    /// into the caller's encoders. The caller keeps its own error and loss callbacks.
    pub fn from_wgpu(adapter: &wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Gpu {
        Gpu::from_parts(adapter.get_info(), device, queue)
    }

    fn from_parts(adapter: wgpu::AdapterInfo, device: wgpu::Device, queue: wgpu::Queue) -> Gpu {
        Gpu {
            inner: Arc::new(Inner {
                timer: Timer::new(&device, &queue),
                device,
                queue,
                adapter,
                pipelines: Pipelines::default(),
                readbacks: AtomicU64::new(0),
                bytes_made: AtomicU64::new(0),
                recorded: Mutex::default(),
                trouble: Arc::default(),
            }),
        }
    }

    /// Returns the same device with the settings of another kind of adapter: workgroup sizes, mesh
    /// access, and the engine `auto`. Its caches and counters are its own.
    pub fn with_settings_of(&self, kind: wgpu::DeviceType) -> Gpu {
        let info = wgpu::AdapterInfo {
            device_type: kind,
            ..self.adapter().clone()
        };
        Gpu::from_parts(info, self.device().clone(), self.queue().clone())
    }

    /// Returns the device.
    pub fn device(&self) -> &wgpu::Device {
        &self.inner.device
    }

    /// Returns the queue.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.inner.queue
    }

    /// Submits work and measures the time ([`Gpu::submit_time`]).
    pub(crate) fn submit(&self, work: impl IntoIterator<Item = wgpu::CommandBuffer>) {
        let began = Instant::now();
        self.queue().submit(work);
        SUBMITTING.set(SUBMITTING.get() + began.elapsed());
    }

    /// Returns information about the adapter.
    pub fn adapter(&self) -> &wgpu::AdapterInfo {
        &self.inner.adapter
    }

    /// Returns the adapter in one line: name, kind and backend.
    pub fn adapter_name(&self) -> String {
        describe(self.adapter())
    }

    /// Returns all adapters in order of preference, one line each.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn adapters() -> Vec<String> {
        enumerate()
            .iter()
            .map(|a| describe(&a.get_info()))
            .collect()
    }

    /// Whether the device was created with all of `features`.
    pub fn has(&self, features: wgpu::Features) -> bool {
        self.device().features().contains(features)
    }

    /// Returns the number of blocking read-backs from this device so far.
    pub fn readbacks(&self) -> u64 {
        self.inner.readbacks.load(Ordering::Relaxed)
    }

    /// Returns the total size of all arrays and buffers created on this device so far, in bytes,
    /// including those already freed.
    pub fn bytes_allocated(&self) -> u64 {
        self.inner.bytes_made.load(Ordering::Relaxed)
    }

    /// Returns the number of recordings of each pass so far, by shader name.
    pub fn passes_recorded(&self) -> BTreeMap<String, u64> {
        lock(&self.inner.recorded).clone()
    }

    pub(super) fn count_pass(&self, name: &str) {
        let mut recorded = lock(&self.inner.recorded);
        match recorded.get_mut(name) {
            Some(count) => *count += 1,
            None => {
                recorded.insert(name.to_owned(), 1);
            }
        }
    }

    /// Waits until the device is idle.
    ///
    /// # Errors
    /// [`Error::DeviceLost`], or [`Error::Gpu`] with an error reported since the last check.
    pub fn wait(&self) -> Result<()> {
        let polled = self.device().poll(wgpu::PollType::wait_indefinitely());
        self.poll_errors()?;
        polled
            .map(|_| ())
            .map_err(|e| Error::DeviceLost(e.to_string()))
    }

    /// Reports a lost device or an error since the last check. Errors of a caller's device
    /// ([`Gpu::from_wgpu`]) are only reported to the caller's own callbacks.
    ///
    /// # Errors
    /// [`Error::DeviceLost`] (and from then on always), or [`Error::Gpu`].
    pub fn poll_errors(&self) -> Result<()> {
        if let Some(DeviceFault::Lost(why)) = &*lock(&self.inner.trouble) {
            return Err(Error::DeviceLost(why.clone()));
        }
        // Polling reports a destroyed device; the reason is stored in `trouble`.
        let _ = self.device().poll(wgpu::PollType::Poll);
        let mut trouble = lock(&self.inner.trouble);
        match trouble.clone() {
            None => Ok(()),
            Some(DeviceFault::Lost(why)) => Err(Error::DeviceLost(why)),
            Some(DeviceFault::Refused(why)) => {
                *trouble = None;
                Err(Error::Gpu(why))
            }
        }
    }

    /// Creates a resource on the device and returns validation and memory errors.
    pub(super) fn create<T>(
        &self,
        label: &str,
        make: impl FnOnce(&wgpu::Device) -> T,
    ) -> Result<T> {
        self.poll_errors()?;
        // A browser reports errors asynchronously: `poll_errors` returns them later.
        #[cfg(target_arch = "wasm32")]
        return Ok((make(self.device()), label).0);
        #[cfg(not(target_arch = "wasm32"))]
        self.create_within_scope(label, make)
    }

    #[cfg(not(target_arch = "wasm32"))]
    fn create_within_scope<T>(
        &self,
        label: &str,
        make: impl FnOnce(&wgpu::Device) -> T,
    ) -> Result<T> {
        let memory = self
            .device()
            .push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let validity = self
            .device()
            .push_error_scope(wgpu::ErrorFilter::Validation);
        let made = make(self.device());
        let refused = pollster::block_on(validity.pop());
        let refused = pollster::block_on(memory.pop()).or(refused);
        match refused {
            None => Ok(made),
            Some(e) => Err(Error::Gpu(format!("{label}: {e}"))),
        }
    }

    pub(super) fn pipelines(&self) -> &Pipelines {
        &self.inner.pipelines
    }

    pub(super) fn timer(&self) -> &Timer {
        &self.inner.timer
    }

    pub(super) fn count_bytes(&self, bytes: u64) {
        self.inner.bytes_made.fetch_add(bytes, Ordering::Relaxed);
    }

    pub(super) fn count_readback(&self) {
        self.inner.readbacks.fetch_add(1, Ordering::Relaxed);
    }
}

/// Locks a mutex and ignores poisoning: the data of all our mutexes stays consistent.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn record_fault(trouble: &Mutex<Option<DeviceFault>>, what: DeviceFault) {
    let mut trouble = lock(trouble);
    let lost_already = matches!(*trouble, Some(DeviceFault::Lost(_)));
    if trouble.is_none() || (!lost_already && matches!(what, DeviceFault::Lost(_))) {
        *trouble = Some(what);
    }
}

/// Returns all adapters, most capable first.
#[cfg(not(target_arch = "wasm32"))]
fn enumerate() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        // Vulkan, Metal and DirectX 12: the software rasteriser is slower with OpenGL.
        backends: wgpu::Backends::PRIMARY,
        // Indirect arguments are written by our own shaders only, and validating each of them costs
        // a dispatch: no VALIDATION_INDIRECT_CALL.
        flags: wgpu::InstanceFlags::empty().with_env(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
    adapters.sort_by_key(|a| rank(a.get_info().device_type));
    adapters
}

fn describe(a: &wgpu::AdapterInfo) -> String {
    let kind = match a.device_type {
        wgpu::DeviceType::Cpu => "software",
        wgpu::DeviceType::DiscreteGpu => "discrete GPU",
        wgpu::DeviceType::IntegratedGpu => "integrated GPU",
        wgpu::DeviceType::VirtualGpu => "virtual GPU",
        wgpu::DeviceType::Other => "other",
    };
    format!("{} ({kind}, {:?})", a.name, a.backend)
}

#[cfg(not(target_arch = "wasm32"))]
fn rank(kind: wgpu::DeviceType) -> u8 {
    match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

#[cfg(not(target_arch = "wasm32"))]
fn choose<'a>(adapters: &'a [wgpu::Adapter], wanted: Option<&str>) -> Result<&'a wgpu::Adapter> {
    let Some(first) = adapters.first() else {
        return Err(Error::NoAdapter(
            "none found; install the Vulkan driver of your GPU, or the software driver (Debian, \
            Ubuntu: apt install mesa-vulkan-drivers libvulkan1; Fedora: dnf install \
            mesa-vulkan-drivers vulkan-loader)"
                .into(),
        ));
    };
    let Some(wanted) = wanted.map(str::trim).filter(|w| !w.is_empty()) else {
        return Ok(first);
    };
    let found = match wanted.parse::<usize>() {
        Ok(index) => adapters.get(index),
        Err(_) => adapters.iter().find(|a| {
            let info = a.get_info();
            let software = info.device_type == wgpu::DeviceType::Cpu;
            (wanted.eq_ignore_ascii_case("cpu") && software)
                || info.name.to_lowercase().contains(&wanted.to_lowercase())
        }),
    };
    found.ok_or_else(|| {
        let list: Vec<String> = adapters
            .iter()
            .enumerate()
            .map(|(i, a)| format!("{i}: {}", a.get_info().name))
            .collect();
        Error::NoAdapter(format!(
            "\"{wanted}\" matches no available adapter ({}); give part of a name, an index, or cpu",
            list.join(", ")
        ))
    })
}
