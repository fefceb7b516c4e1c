//! Configuration of the device, and its errors.

use crate::app::App;
use eframe::egui;
use eframe::egui_wgpu::{SurfaceConfig, WgpuConfiguration, WgpuSetupCreateNew};
use palpate::Error;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Returns the device configuration: the limits that Palpate requires.
pub(crate) fn device() -> WgpuConfiguration {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.instance_descriptor.backends = wgpu::Backends::PRIMARY;
    setup.instance_descriptor.flags = wgpu::InstanceFlags::empty();
    setup.device_descriptor = Arc::new(|adapter| wgpu::DeviceDescriptor {
        label: Some("palpate-view"),
        required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
        required_limits: wgpu::Limits::default(),
        ..Default::default()
    });
    let surface = SurfaceConfig {
        present_mode: wgpu::PresentMode::AutoNoVsync,
        ..SurfaceConfig::LOW_LATENCY
    };
    WgpuConfiguration {
        surface,
        wgpu_setup: setup.into(),
        ..WgpuConfiguration::default()
    }
}

/// Asynchronous device errors: device loss and validation errors.
#[derive(Default)]
pub(crate) struct DeviceFault {
    pub lost: Option<String>,
    refused: Option<String>,
}

/// Records errors of the device and requests a frame that reports them.
pub(crate) fn listen(device: &wgpu::Device, context: &egui::Context) -> Arc<Mutex<DeviceFault>> {
    let trouble = Arc::new(Mutex::new(DeviceFault::default()));
    let (noted, looks) = (trouble.clone(), context.clone());
    device.set_device_lost_callback(move |_, why| {
        lock(&noted).lost = Some(why);
        looks.request_repaint();
    });
    let (noted, looks) = (trouble.clone(), context.clone());
    device.on_uncaptured_error(Arc::new(move |why: wgpu::Error| {
        lock(&noted).refused = Some(why.to_string());
        looks.request_repaint();
    }));
    trouble
}

/// Locks, also after a panic of another holder.
pub(crate) fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl App {
    /// Returns device errors since the last frame; after device loss, that error.
    pub(crate) fn device_trouble(&self) -> Option<Error> {
        let checked = self.gpu.poll_errors().err();
        let mut trouble = lock(&self.trouble);
        let refused = trouble.refused.take();
        match &trouble.lost {
            Some(why) => Some(Error::DeviceLost(why.clone())),
            None => refused.map(Error::Gpu).or(checked),
        }
    }
}
