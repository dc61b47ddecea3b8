//! An adapter and a device on it.

use super::fault::{self, Fault};
use crate::error::ViewerError;
use std::fmt;
use std::str::FromStr;
use wgpu::{DownlevelFlags, ErrorFilter, Features, Limits};

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

impl AdapterChoice {
    fn fits(&self, adapter: &wgpu::Adapter) -> bool {
        match self {
            AdapterChoice::Best => true,
            AdapterChoice::Software => adapter.get_info().device_type == wgpu::DeviceType::Cpu,
            AdapterChoice::Named(part) => name(adapter).to_lowercase().contains(&part.to_lowercase()),
        }
    }
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
    /// Adapter that draws.
    pub adapter: wgpu::Adapter,
    /// Device that makes buffers, textures and pipelines.
    pub device: wgpu::Device,
    /// Queue of its commands.
    pub queue: wgpu::Queue,
    /// The optional features that it has and that are used.
    pub features: Features,
    fault: Fault,
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
        fn unable(what: &str, adapter: &wgpu::Adapter) -> ViewerError {
            ViewerError::Unable { adapter: describe(adapter), what: what.to_owned() }
        }

        // Without these no picture can be drawn at all.
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
                return Err(unable(what, &adapter));
            }
        }

        // The usual limits, but for sizes: of those, all that there is.
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
            .map_err(|error| failed(&adapter, "opening the device", &error.to_string()))?;
        let fault = Fault::of(&device);
        Ok(Gpu { adapter, device, queue, features, fault })
    }

    /// Name, kind and interface of the adapter, for people.
    pub fn describe(&self) -> String {
        describe(&self.adapter)
    }

    /// Whether shaders have to write depth, since what the rasteriser makes of it is not exact.
    pub fn writes_depth(&self) -> bool {
        self.adapter.get_info().backend == wgpu::Backend::Gl
    }

    /// Whether pictures can be drawn with several samples a pixel.
    pub fn multisamples(&self) -> bool {
        // Where depth is written, each sample needs a look of its own.
        let apart = self.adapter.get_downlevel_capabilities().flags;
        !self.writes_depth() || apart.contains(DownlevelFlags::MULTISAMPLED_SHADING)
    }

    /// Whether a processor draws, which takes longer for everything.
    pub fn is_software(&self) -> bool {
        self.adapter.get_info().device_type == wgpu::DeviceType::Cpu
    }

    /// The module of a shader in several parts.
    pub fn shader(&self, parts: &[&str]) -> wgpu::ShaderModule {
        let source = wgpu::ShaderSource::Wgsl(parts.concat().into());
        self.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source })
    }

    /// Does something, of which the device may say only afterwards that it cannot be done.
    ///
    /// # Errors
    /// [`ViewerError::Device`] with what it says.
    pub fn attempt<T>(&self, what: &'static str, work: impl FnOnce() -> T) -> Result<T, ViewerError> {
        let all = [ErrorFilter::Internal, ErrorFilter::Validation, ErrorFilter::OutOfMemory];
        let scopes = all.map(|filter| self.device.push_error_scope(filter));
        let done = work();
        // All have to end, the last one first.
        let mut complaint = None;
        for scope in scopes.into_iter().rev() {
            complaint = pollster::block_on(scope.pop()).or(complaint);
        }
        match complaint {
            Some(complaint) => Err(self.failed(what, &complaint.to_string())),
            None => Ok(done),
        }
    }

    /// Whether the device has refused nothing, and is there.
    ///
    /// # Errors
    /// [`ViewerError::Device`] with the first that it complained of.
    pub fn check(&self, what: &'static str) -> Result<(), ViewerError> {
        self.fault.get().map_or(Ok(()), |complaint| Err(self.failed(what, complaint)))
    }

    /// Waits for all that was submitted.
    ///
    /// # Errors
    /// [`ViewerError::Device`].
    pub fn wait(&self) -> Result<(), ViewerError> {
        self.poll(wgpu::PollType::wait_indefinitely());
        self.check("waiting")
    }

    /// Takes in what has been done. A device that is lost says so at the next [`Gpu::check`].
    pub fn poll(&self, how: wgpu::PollType) {
        match fault::catch(|| self.device.poll(how)) {
            Ok(Ok(_)) => {}
            Ok(Err(error)) => self.fault.note(&error.to_string()),
            Err(panic) => self.fault.note(&panic),
        }
    }

    /// The error of something that failed.
    pub fn failed(&self, what: &'static str, reason: &str) -> ViewerError {
        failed(&self.adapter, what, reason)
    }
}

fn failed(adapter: &wgpu::Adapter, what: &'static str, reason: &str) -> ViewerError {
    ViewerError::Device { adapter: describe(adapter), what, reason: fault::one_line(reason) }
}

fn name(adapter: &wgpu::Adapter) -> String {
    adapter.get_info().name
}

fn describe(adapter: &wgpu::Adapter) -> String {
    let info = adapter.get_info();
    let driver = [info.driver, info.driver_info].join(" ");
    format!("{} ({:?}, {}, {})", info.name, info.device_type, info.backend, driver.trim())
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
    pollster::block_on(instance.request_adapter(&options)).map_err(|error| none(&error.to_string()))
}

/// No adapter, for what wgpu says of each interface.
pub fn none(said: &str) -> ViewerError {
    let said = said.strip_prefix("No suitable graphics adapter found; ").unwrap_or(said);
    // Of those that nobody asked for, and of the one that draws nothing, there is nothing to say.
    fn is_idle(part: &&str) -> bool {
        part.ends_with("not requested") || part.starts_with("noop ")
    }
    let said: Vec<&str> = said.trim_end_matches(": {}").split(", ").filter(|part| !is_idle(part)).collect();
    let asked = std::env::var("WGPU_BACKEND").map(|name| format!(" of WGPU_BACKEND={name}"));
    ViewerError::NoAdapter {
        wanted: AdapterChoice::Best.to_string() + &asked.unwrap_or_default(),
        reason: if said.is_empty() { "no such interface".to_owned() } else { said.join(", ") },
    }
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
    all.into_iter().find(|adapter| choice.fits(adapter)).ok_or_else(|| ViewerError::NoAdapter {
        wanted: choice.to_string(),
        reason: if names.is_empty() {
            "there is none".to_owned()
        } else {
            format!("there are only: {}", names.join(", "))
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_was_asked_for_is_told() {
        let told = |said: &str| match none(said) {
            ViewerError::NoAdapter { reason, .. } => reason,
            other => other.to_string(),
        };
        let all = "No suitable graphics adapter found; noop not explicitly enabled, vulkan found no adapters, gl not requested";
        assert_eq!(told(all), "vulkan found no adapters");
        assert_eq!(
            told("No suitable graphics adapter found; noop not requested, gl not requested"),
            "no such interface"
        );
        assert_eq!(told("no surface for any: {}"), "no surface for any");
    }
}
