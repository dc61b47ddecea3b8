//! An adapter and a device on it.

use crate::error::ViewerError;
use std::fmt;
use std::str::FromStr;
use wgpu::{DownlevelFlags, Features, Limits};

/// Which adapter is to draw.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub enum AdapterChoice {
    /// The fastest there is, a software one if need be.
    #[default]
    Best,
    /// One that draws on the processor.
    Software,
    /// The first whose name contains this, in whatever case.
    Named(String),
}

impl FromStr for AdapterChoice {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "" | "best" => AdapterChoice::Best,
            "software" => AdapterChoice::Software,
            name => AdapterChoice::Named(name.to_owned()),
        })
    }
}

impl fmt::Display for AdapterChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            AdapterChoice::Best => f.write_str("any"),
            AdapterChoice::Software => f.write_str("a software adapter"),
            AdapterChoice::Named(name) => write!(f, "one with '{name}' in its name"),
        }
    }
}

/// A device to draw with. Asks the adapter for nothing that it lacks.
#[derive(Debug)]
pub struct Gpu {
    /// What draws.
    pub adapter: wgpu::Adapter,
    /// What makes things on it.
    pub device: wgpu::Device,
    /// What takes its orders.
    pub queue: wgpu::Queue,
    /// The optional features that it has and that are used.
    pub features: Features,
}

/// Used where they are there.
const WELCOME: Features = Features::INDIRECT_FIRST_INSTANCE.union(Features::POLYGON_MODE_LINE);

impl Gpu {
    /// How to make an instance whose surfaces [`Gpu::for_surface`] takes; `display` is what the window system goes by.
    pub fn instance(display: Option<Box<dyn wgpu::wgt::WgpuHasDisplayHandle>>) -> wgpu::Instance {
        // Indirect draws are made here and are right; checking them would cost a pass over all of them.
        let flags = wgpu::InstanceFlags::from_build_config().with_env()
            - wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL;
        wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::from_env().unwrap_or_default(),
            flags,
            memory_budget_thresholds: wgpu::MemoryBudgetThresholds::default(),
            backend_options: wgpu::BackendOptions::from_env_or_default(),
            display,
        })
    }

    /// A device that draws into images only.
    ///
    /// # Errors
    /// [`ViewerError::NoAdapter`], [`ViewerError::Unable`], [`ViewerError::Device`].
    pub fn headless(choice: &AdapterChoice) -> Result<Gpu, ViewerError> {
        let instance = Gpu::instance(None);
        Gpu::new(choose(&instance, choice, None)?)
    }

    /// A device that draws into a window.
    ///
    /// # Errors
    /// As [`Gpu::headless`].
    pub fn for_surface(
        instance: &wgpu::Instance,
        surface: &wgpu::Surface<'_>,
        adapter: &AdapterChoice,
    ) -> Result<Gpu, ViewerError> {
        Gpu::new(choose(instance, adapter, Some(surface))?)
    }

    fn new(adapter: wgpu::Adapter) -> Result<Gpu, ViewerError> {
        let unable = |what: &str| ViewerError::Unable { adapter: name(&adapter), what: what.to_owned() };
        let can = adapter.get_downlevel_capabilities().flags;
        for (flag, what) in [
            (DownlevelFlags::COMPUTE_SHADERS, "compute shaders"),
            (DownlevelFlags::VERTEX_STORAGE, "storage buffers in vertex shaders"),
            (DownlevelFlags::FRAGMENT_WRITABLE_STORAGE, "storage buffers in fragment shaders"),
            (DownlevelFlags::BASE_VERTEX, "numbering vertices from a base"),
            (DownlevelFlags::INDIRECT_EXECUTION, "indirect draws"),
            (DownlevelFlags::UNRESTRICTED_INDEX_BUFFER, "index buffers that are storage too"),
        ] {
            if !can.contains(flag) {
                return Err(unable(what));
            }
        }
        let features = adapter.features() & WELCOME;
        let has = adapter.limits();
        let limits = Limits {
            max_buffer_size: has.max_buffer_size,
            max_storage_buffer_binding_size: has.max_storage_buffer_binding_size,
            max_texture_dimension_2d: has.max_texture_dimension_2d,
            ..Limits::default()
        };
        let device = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("chpm"),
            required_features: features,
            required_limits: limits,
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(device)
            .map_err(|error| ViewerError::Device { what: "opening the device", reason: error.to_string() })?;
        Ok(Gpu { adapter, device, queue, features })
    }

    /// Name, kind and interface of the adapter, for people.
    pub fn describe(&self) -> String {
        let info = self.adapter.get_info();
        let driver = [info.driver, info.driver_info].join(" ");
        format!("{} ({:?}, {}, {})", info.name, info.device_type, info.backend, driver.trim())
    }
}

fn name(adapter: &wgpu::Adapter) -> String {
    adapter.get_info().name
}

fn request(
    instance: &wgpu::Instance,
    surface: Option<&wgpu::Surface<'_>>,
) -> Result<wgpu::Adapter, ViewerError> {
    let options = wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::HighPerformance,
        compatible_surface: surface,
        ..Default::default()
    };
    pollster::block_on(instance.request_adapter(&options)).map_err(|error| ViewerError::NoAdapter {
        wanted: AdapterChoice::Best.to_string(),
        reason: error.to_string(),
    })
}

fn choose(
    instance: &wgpu::Instance,
    choice: &AdapterChoice,
    surface: Option<&wgpu::Surface<'_>>,
) -> Result<wgpu::Adapter, ViewerError> {
    if *choice == AdapterChoice::Best {
        return request(instance, surface);
    }
    let mut all = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    all.retain(|adapter| surface.is_none_or(|surface| adapter.is_surface_supported(surface)));
    let names: Vec<String> = all.iter().map(name).collect();
    let fits = |adapter: &wgpu::Adapter| match choice {
        AdapterChoice::Best => true,
        AdapterChoice::Software => adapter.get_info().device_type == wgpu::DeviceType::Cpu,
        AdapterChoice::Named(part) => name(adapter).to_lowercase().contains(&part.to_lowercase()),
    };
    all.into_iter().find(fits).ok_or_else(|| ViewerError::NoAdapter {
        wanted: choice.to_string(),
        reason: if names.is_empty() {
            "there is none".to_owned()
        } else {
            format!("there are only: {}", names.join(", "))
        },
    })
}
