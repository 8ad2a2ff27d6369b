//! The graphics adapter, and whether there is one and a display at all.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// An adapter in words.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct AdapterBrief {
    /// The adapter's own name, for example `llvmpipe (LLVM 15.0.6, 256 bits)`.
    pub name: String,
    /// Interface used, for example `vulkan`.
    pub backend: String,
    /// Whether the CPU draws.
    pub is_cpu: bool,
}

impl AdapterBrief {
    /// The words for an adapter's own description.
    pub(crate) fn new(info: &wgpu::AdapterInfo) -> Self {
        let cpu_names = ["llvmpipe", "softpipe", "swiftshader"];
        let name = info.name.to_lowercase();
        Self {
            name: info.name.clone(),
            backend: info.backend.to_str().to_owned(),
            // some GL drivers do not tell their kind
            is_cpu: info.device_type == wgpu::DeviceType::Cpu
                || cpu_names.iter().any(|n| name.contains(n)),
        }
    }
}

/// What a viewer would find on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Probe {
    /// Whether a window can be opened.
    pub display: bool,
    /// Why not and what to do; empty where it can.
    pub display_note: String,
    /// The adapter that would draw; `None` where there is none.
    pub adapter: Option<AdapterBrief>,
}

/// Looks for a display and an adapter. Opens no window and starts no raster threads; never panics.
pub fn probe() -> Probe {
    let display_note = display_problem().unwrap_or_default();
    let adapter = std::panic::catch_unwind(|| {
        request()
            .ok()
            .map(|(_, a)| AdapterBrief::new(&a.get_info()))
    });
    Probe {
        display: display_note.is_empty(),
        display_note,
        adapter: adapter.ok().flatten(),
    }
}

/// Device and queue with the adapter's words.
#[derive(Debug)]
pub(crate) struct Gpu {
    /// The device.
    pub(crate) device: wgpu::Device,
    /// Its queue.
    pub(crate) queue: wgpu::Queue,
    /// The adapter.
    pub(crate) adapter: AdapterBrief,
}

/// What an adapter says of its own end, and of what it could not do.
#[derive(Debug, Clone)]
pub(crate) struct Watch(Arc<Mutex<Option<String>>>);

impl Watch {
    /// Listens to a device; without it an error would end the process.
    pub(crate) fn new(device: &wgpu::Device) -> Self {
        let watch = Self(Arc::new(Mutex::new(None)));
        let of_errors = watch.clone();
        device.on_uncaptured_error(Arc::new(move |e| of_errors.note(&e.to_string())));
        let of_end = watch.clone();
        device.set_device_lost_callback(move |reason, text| {
            of_end.note(&format!("it was lost, {reason:?} {text}"));
        });
        watch
    }

    /// Keeps the first word: the others follow from it.
    fn note(&self, text: &str) {
        let mut first = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        first.get_or_insert_with(|| first_line(text).to_owned());
    }

    /// An error where the adapter failed since the start.
    pub(crate) fn check(&self) -> anyhow::Result<()> {
        let first = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match first.as_ref() {
            Some(text) => anyhow::bail!(
                "the graphics adapter failed ({text}); start the viewer again, the session goes on"
            ),
            None => Ok(()),
        }
    }
}

/// The error line for a machine without an adapter.
pub(crate) const NO_ADAPTER: &str = "no graphics adapter: neither a graphics card's driver nor a \
    software one answers; install a Vulkan driver (Debian/Ubuntu: apt install mesa-vulkan-drivers)";

/// Opens the adapter for drawing without a window.
pub(crate) fn open() -> anyhow::Result<Gpu> {
    let (_, adapter) = request()?;
    let descriptor = device_descriptor(&adapter);
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).map_err(|e| {
        anyhow::anyhow!(
            "the adapter {} gives no device ({e}); update its driver",
            adapter.get_info().name
        )
    })?;
    Ok(Gpu {
        device,
        queue,
        adapter: AdapterBrief::new(&adapter.get_info()),
    })
}

fn request() -> anyhow::Result<(wgpu::Instance, wgpu::Adapter)> {
    let instance = wgpu::Instance::new(instance_descriptor());
    let options = wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::HighPerformance,
        ..Default::default()
    };
    let adapter = pollster::block_on(instance.request_adapter(&options))
        .map_err(|e| anyhow::anyhow!("{NO_ADAPTER} ({})", first_line(&e.to_string())))?;
    Ok((instance, adapter))
}

/// All backends unless `WGPU_BACKEND` chooses; old drivers are let in.
pub(crate) fn instance_descriptor() -> wgpu::InstanceDescriptor {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.flags |= wgpu::InstanceFlags::ALLOW_UNDERLYING_NONCOMPLIANT_ADAPTER;
    descriptor.with_env()
}

/// Default limits, with the adapter's own textures: 3-D atlas, and pictures of large screens.
pub(crate) fn device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
    let own = adapter.limits();
    let small = wgpu::Limits::downlevel_webgl2_defaults();
    let base = if own.check_limits(&wgpu::Limits::default()) {
        wgpu::Limits::default()
    } else {
        small
    };
    wgpu::DeviceDescriptor {
        label: Some("osteon viewer"),
        required_limits: wgpu::Limits {
            max_texture_dimension_2d: own.max_texture_dimension_2d,
            max_texture_dimension_3d: own.max_texture_dimension_3d,
            max_buffer_size: own.max_buffer_size,
            // for the thesis's kernel in the report; none of it where the adapter computes nothing
            max_storage_buffers_per_shader_stage: own.max_storage_buffers_per_shader_stage,
            max_storage_buffer_binding_size: own.max_storage_buffer_binding_size,
            max_compute_workgroup_storage_size: own.max_compute_workgroup_storage_size,
            max_compute_invocations_per_workgroup: own.max_compute_invocations_per_workgroup,
            max_compute_workgroup_size_x: own.max_compute_workgroup_size_x,
            max_compute_workgroup_size_y: own.max_compute_workgroup_size_y,
            max_compute_workgroup_size_z: own.max_compute_workgroup_size_z,
            max_compute_workgroups_per_dimension: own.max_compute_workgroups_per_dimension,
            ..base
        },
        ..Default::default()
    }
}

/// First line of a message: errors here are one line.
pub(crate) fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default().trim()
}

/// Why no window can be opened, with the remedy; `None` where one can.
pub(crate) fn display_problem() -> Option<String> {
    #[cfg(all(unix, not(target_os = "macos")))]
    {
        let wayland = std::env::var_os("WAYLAND_DISPLAY").filter(|v| !v.is_empty());
        let x11 = std::env::var("DISPLAY").unwrap_or_default();
        if wayland.is_none() && x11.is_empty() {
            return Some(
                "no display: neither DISPLAY nor WAYLAND_DISPLAY is set; log in to a desktop or draw with --offscreen FILE.png"
                    .into(),
            );
        }
        if wayland.is_some_and(|name| wayland_answers(Path::new(&name))) {
            return None;
        }
        if !x11_answers(&x11) {
            return Some(format!(
                "no display: nobody answers on DISPLAY={x11}; correct it or draw with --offscreen FILE.png"
            ));
        }
        missing_library()
    }
    #[cfg(not(all(unix, not(target_os = "macos"))))]
    None
}

#[cfg(all(unix, not(target_os = "macos")))]
fn wayland_answers(name: &Path) -> bool {
    let folder = std::env::var_os("XDG_RUNTIME_DIR").unwrap_or_default();
    let path = Path::new(&folder).join(name);
    std::os::unix::net::UnixStream::connect(path).is_ok()
}

/// Whether an X server listens: `[host]:number[.screen]`.
#[cfg(all(unix, not(target_os = "macos")))]
fn x11_answers(display: &str) -> bool {
    let Some((host, rest)) = display.rsplit_once(':') else {
        return false;
    };
    let Ok(number) = rest.split('.').next().unwrap_or_default().parse::<u16>() else {
        return false;
    };
    if host.is_empty() || host == "unix" {
        let path = format!("/tmp/.X11-unix/X{number}");
        return std::os::unix::net::UnixStream::connect(&path).is_ok() || abstract_answers(&path);
    }
    let port = 6000u16.saturating_add(number);
    std::net::TcpStream::connect((host, port)).is_ok()
}

#[cfg(target_os = "linux")]
fn abstract_answers(name: &str) -> bool {
    use std::os::linux::net::SocketAddrExt as _;
    use std::os::unix::net::{SocketAddr, UnixStream};
    SocketAddr::from_abstract_name(name)
        .and_then(|address| UnixStream::connect_addr(&address))
        .is_ok()
}

#[cfg(all(unix, not(target_os = "macos"), not(target_os = "linux")))]
fn abstract_answers(_name: &str) -> bool {
    false
}

/// The libraries that a window under X11 opens at run time, with their packages. A missing
/// libxkbcommon-x11 would end the program in a panic of the window library.
#[cfg(all(unix, not(target_os = "macos")))]
const X11_LIBRARIES: [(&str, &str); 5] = [
    ("libX11.so.6", "libx11-6"),
    ("libX11-xcb.so.1", "libx11-xcb1"),
    ("libXcursor.so.1", "libxcursor1"),
    ("libXi.so.6", "libxi6"),
    ("libxkbcommon-x11.so.0", "libxkbcommon-x11-0"),
];

#[cfg(all(unix, not(target_os = "macos")))]
fn missing_library() -> Option<String> {
    let folders = library_folders();
    let absent: Vec<&str> = X11_LIBRARIES
        .iter()
        .filter(|(file, _)| !folders.iter().any(|f| f.join(file).exists()))
        .map(|&(_, package)| package)
        .collect();
    (!absent.is_empty()).then(|| {
        format!(
            "no display: libraries of the window system are missing; Debian/Ubuntu: apt install {}, or draw with --offscreen FILE.png",
            absent.join(" ")
        )
    })
}

/// Folders where the dynamic linker looks: its variable, the usual ones, and those of ld.so.conf.d.
#[cfg(all(unix, not(target_os = "macos")))]
fn library_folders() -> Vec<std::path::PathBuf> {
    let mut folders: Vec<std::path::PathBuf> = std::env::var_os("LD_LIBRARY_PATH")
        .map(|v| std::env::split_paths(&v).collect())
        .unwrap_or_default();
    let triple = format!("{}-linux-gnu", std::env::consts::ARCH);
    for root in ["/lib", "/usr/lib", "/lib64", "/usr/lib64", "/usr/local/lib"] {
        folders.push(root.into());
        folders.push(Path::new(root).join(&triple));
    }
    folders.push("/run/opengl-driver/lib".into());
    let Ok(entries) = std::fs::read_dir("/etc/ld.so.conf.d") else {
        return folders;
    };
    for entry in entries.flatten() {
        let text = std::fs::read_to_string(entry.path()).unwrap_or_default();
        let lines = text.lines().map(str::trim).filter(|l| l.starts_with('/'));
        folders.extend(lines.map(std::path::PathBuf::from));
    }
    folders
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_display_that_is_not_there_is_not_found() {
        for name in [
            "",
            "7",
            ":",
            ":x",
            ":54321",
            "localhost:64999",
            "nowhere.invalid:1.0",
        ] {
            assert!(!x11_answers(name), "{name}");
        }
    }

    #[test]
    fn looking_for_a_display_and_an_adapter_never_panics() {
        let probe = probe();
        assert_eq!(probe.display, probe.display_note.is_empty());
        assert!(probe.adapter.is_none_or(|a| !a.name.is_empty()));
    }
}
