//! The window.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use crate::adapter::{self, AdapterBrief};
use crate::cli::ViewArgs;
use crate::link::{Joining, Link, Shared};
use crate::memory::{self, Remembered};
use crate::mirror::End;
use crate::panels::slices::Slices;
use crate::panels::{self, Status, Wish};
use crate::render::Renderer;
use crate::render::blit::Blit;
use crate::screenshot::Screenshot;
use crate::session::{Drawn, Manners, Session};
use anyhow::{Context as _, anyhow};
use eframe::egui_wgpu;
use glam::DVec2;
use osteon_protocol::ipc::{Command, Role};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How long the last messages may take to leave.
const FAREWELL: Duration = Duration::from_millis(200);

/// Poses a second that a window wants: more than it draws, for the plots.
const WINDOW_POSE_HZ: u16 = 125;

/// Opens the window and shows the session in it.
pub(crate) fn run(
    args: ViewArgs,
    manners: impl FnOnce(bool) -> Manners + 'static,
) -> anyhow::Result<()> {
    if let Some(problem) = adapter::display_problem() {
        anyhow::bail!("{problem}");
    }
    let shared = Shared::new();
    let joining = Joining {
        name: "osteon view, window".to_owned(),
        role: args.role,
        control: args.role != Role::Projector,
        pose_hz: WINDOW_POSE_HZ,
    };
    let link = Link::start(&args.place(), &joining, &shared)?;
    let outcome: Outcome = Arc::new(Mutex::new(None));
    let (told, app_shared) = (Arc::clone(&outcome), Arc::clone(&shared));
    let options = options(&args);
    let create: eframe::AppCreator<'_> = Box::new(move |context| {
        let app = App::new(context, args, link, app_shared, manners, told)?;
        Ok(Box::new(app))
    });
    // the window library panics where it lacks a shared library that we did not look for
    let ran = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        eframe::run_native("Osteon", options, create)
    }));
    match ran {
        Ok(Ok(())) => {}
        Ok(Err(e)) => return Err(window_error(&e)),
        Err(_) => anyhow::bail!(
            "the window library gave up (see the line above); install the missing library or draw with --offscreen FILE.png"
        ),
    }
    let failure = outcome
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .take();
    if let Some(e) = failure {
        return Err(e);
    }
    match &shared.mirror().end {
        Some(End::Failed(reason)) => anyhow::bail!("{reason}"),
        Some(End::Bye(_)) | None => Ok(()),
    }
}

/// Where the app leaves an error that ends it.
type Outcome = Arc<Mutex<Option<anyhow::Error>>>;

fn window_error(error: &eframe::Error) -> anyhow::Error {
    let line = error.to_string();
    let line = adapter::first_line(&line);
    match error {
        eframe::Error::Wgpu(_) => anyhow!("{} ({line})", adapter::NO_ADAPTER),
        eframe::Error::AppCreation(e) => anyhow!("{e}"),
        _ => anyhow!(
            "no display: the window cannot be opened ({line}); check DISPLAY or draw with --offscreen FILE.png"
        ),
    }
}

fn options(args: &ViewArgs) -> eframe::NativeOptions {
    let [width, height] = args.size.map(|n| n as f32);
    let mut setup = egui_wgpu::WgpuSetupCreateNew::without_display_handle();
    setup.instance_descriptor = adapter::instance_descriptor();
    setup.device_descriptor = Arc::new(adapter::device_descriptor);
    eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Osteon")
            .with_app_id("osteon")
            .with_inner_size([width, height])
            .with_min_inner_size([800.0, 500.0]),
        wgpu_options: egui_wgpu::WgpuConfiguration {
            wgpu_setup: egui_wgpu::WgpuSetup::CreateNew(setup),
            ..Default::default()
        },
        ..Default::default()
    }
}

struct App {
    session: Session,
    link: Option<Link>,
    device: wgpu::Device,
    queue: wgpu::Queue,
    blits: [Blit; 2],
    slices: Slices,
    open: Remembered,
    screenshot: Screenshot,
    args: ViewArgs,
    outcome: Outcome,
    pace: Arc<Mutex<Instant>>,
    until: Option<Instant>,
    last_frame: Option<Instant>,
    work: Duration,
    help: bool,
    clutch_key: bool,
    complaint: String,
}

impl App {
    fn new(
        context: &eframe::CreationContext<'_>,
        args: ViewArgs,
        link: Link,
        shared: Arc<Shared>,
        manners: impl FnOnce(bool) -> Manners,
        outcome: Outcome,
    ) -> anyhow::Result<Self> {
        let state = context
            .wgpu_render_state
            .as_ref()
            .context(adapter::NO_ADAPTER)?;
        let brief = AdapterBrief::new(&state.adapter.get_info());
        let manners = manners(brief.is_cpu);
        panels::style(&context.egui_ctx);
        let pace = Arc::new(Mutex::new(Instant::now()));
        let (ctx, next) = (context.egui_ctx.clone(), Arc::clone(&pace));
        // messages come a thousand times a second; frames at their own pace
        shared.on_change(move || {
            let next = *next.lock().unwrap_or_else(PoisonError::into_inner);
            ctx.request_repaint_after(next.saturating_duration_since(Instant::now()));
        });
        let renderer = Renderer::new(&state.device, &state.queue);
        let mut open = memory::path().map_or_else(Remembered::default, |p| memory::read(&p));
        if let Some(kind) = args.renderer {
            open.view.method = kind;
        }
        let mut session = Session::new(shared, renderer, brief, &args, manners);
        session.view = open.view;
        Ok(Self {
            session,
            link: Some(link),
            device: state.device.clone(),
            queue: state.queue.clone(),
            blits: [(); 2].map(|()| Blit::new(&state.device, state.target_format)),
            slices: Slices::default(),
            open,
            screenshot: Screenshot::new(&args),
            until: args
                .seconds
                .map(|s| Instant::now() + Duration::from_secs_f64(s)),
            args,
            outcome,
            pace,
            last_frame: None,
            work: Duration::ZERO,
            help: false,
            clutch_key: false,
            complaint: String::new(),
        })
    }

    fn obey(&mut self, ctx: &egui::Context, wish: Wish, size: [u32; 2]) {
        match wish {
            Wish::Command(command) => self.send(command),
            Wish::WholeBone => self.session.show_whole(size),
            Wish::Glenoid => self.session.show_glenoid(),
            Wish::ToggleTool => self.session.show_tool = !self.session.show_tool,
            Wish::View(choice) => self.session.view = choice,
            Wish::LookFrom(preset) => self.session.look_from(preset),
            Wish::ToggleStereo => self.session.stereo = !self.session.stereo,
            Wish::ToggleSlices => self.open.slices = !self.open.slices,
            Wish::TogglePlots => self.open.plots = !self.open.plots,
            Wish::Plots(quantities) => self.open.quantities = quantities,
            Wish::SavePicture => self.complaint = crate::screenshot::save(ctx),
            Wish::ToggleHelp => self.help = !self.help,
            Wish::Quit => ctx.send_viewport_cmd(egui::ViewportCommand::Close),
        }
    }

    fn send(&mut self, command: Command) {
        let sent = self.link.as_ref().is_some_and(|l| l.command(command));
        let broken = self.session.shared().mirror().broken;
        self.complaint = if sent && !broken {
            String::new()
        } else {
            "the last command was not sent: the haptics process does not read".to_owned()
        };
    }

    /// The 3-D view in the rest of the window. Returns its size in pixels.
    fn view(&mut self, ui: &mut egui::Ui) -> [u32; 2] {
        let (rect, response) =
            ui.allocate_exact_size(ui.available_size(), egui::Sense::click_and_drag());
        let points = ui.ctx().pixels_per_point();
        // positive and far below 2³²
        let size = [rect.width(), rect.height()].map(|n| (n * points).round().max(1.0) as u32);
        self.steer(ui, &response);
        let begin = Instant::now();
        let stereo = self.session.stereo;
        let half = [size[0].div_ceil(2), size[1]];
        let scaled = self.session.scaled(if stereo { half } else { size });
        let shadows = !self.session.adapter.is_cpu;
        match self.session.draw(scaled, shadows) {
            Ok(Drawn::New) => {
                self.adapt(begin);
                self.count_frame(begin);
            }
            Ok(Drawn::Unchanged) => self.last_frame = None,
            Err(e) => {
                *self.outcome.lock().unwrap_or_else(PoisonError::into_inner) = Some(e);
                ui.ctx().send_viewport_cmd(egui::ViewportCommand::Close);
            }
        }
        if self.session.camera.is_some() {
            let renderer = &self.session.renderer;
            let (left, right) = rect.split_left_right_at_fraction(0.5);
            let parts = if stereo {
                vec![
                    (left, renderer.picture()),
                    (right, renderer.picture_right()),
                ]
            } else {
                vec![(rect, renderer.picture())]
            };
            for (blit, (part, picture)) in self.blits.iter().zip(parts) {
                let shape = blit.paint(&self.device, &self.queue, &picture, part, points);
                ui.painter().add(shape);
            }
        }
        size
    }

    /// Where the CPU draws: waits for the picture, and lowers the scale where that took too long.
    fn adapt(&mut self, begin: Instant) {
        // a bone that is still arriving takes long for another reason
        if self.session.adapter.is_cpu && !self.session.is_behind() {
            match self.session.renderer.wait() {
                Ok(()) => self
                    .session
                    .scale
                    .heard(begin.elapsed().as_secs_f64() * 1e3),
                Err(e) => self.complaint = format!("{e:#}"),
            }
        }
    }

    fn count_frame(&mut self, begin: Instant) {
        if let Some(last) = self.last_frame.replace(begin) {
            self.work = begin - last;
            self.session.times.push(self.work);
        }
    }

    fn steer(&mut self, ui: &egui::Ui, response: &egui::Response) {
        let Some(camera) = &mut self.session.camera else {
            return;
        };
        let height = f64::from(response.rect.height().max(1.0));
        let moved = response.drag_motion();
        let drag = DVec2::new(f64::from(moved.x), f64::from(moved.y)) / height;
        if response.dragged_by(egui::PointerButton::Primary) {
            camera.orbit(drag);
        } else if response.dragged() {
            camera.pan(drag);
        }
        if response.hovered() {
            let scroll = ui.input(|i| f64::from(i.smooth_scroll_delta().y));
            if scroll != 0.0 {
                camera.zoom(scroll / 50.0);
            }
        }
    }

    /// A file that was dropped on the window: a session has one bone, so what to do is said.
    fn take_dropped(&mut self, ctx: &egui::Context) {
        let dropped = ctx.input(|i| i.raw.dropped_files.first().map(|f| f.path().to_path_buf()));
        if let Some(path) = dropped {
            self.complaint = dropped_words(&path);
        }
    }

    fn status(&self) -> Status {
        let mut status = Status::new(&self.session.shared().mirror());
        status.socket = self.args.place().to_string();
        status.fps = self
            .session
            .times
            .quantiles()
            .map_or(0.0, |q| 1e3 / f64::from(q.p50.max(1e-3)));
        status.adapter.clone_from(&self.session.adapter.name);
        status.software = self.session.adapter.is_cpu;
        status.scale = self.session.scale.now();
        status.layers = Arc::clone(&self.session.layers);
        status.view = self.session.view;
        if !self.complaint.is_empty() {
            status.complaint.clone_from(&self.complaint);
        }
        status.fates = self.session.renderer.fates();
        status.plots = self.open.quantities;
        status
    }

    fn is_over(&self) -> bool {
        self.until.is_some_and(|t| Instant::now() >= t)
            || self.session.shared().mirror().end.is_some()
    }
}

/// What to do with a file or folder that was dropped on the window.
fn dropped_words(path: &std::path::Path) -> String {
    format!(
        "a session keeps its bone; for this one run:  osteon import {0} --out NEW  and then  osteon demo --scene NEW",
        path.display()
    )
}

impl eframe::App for App {
    fn logic(&mut self, ctx: &egui::Context, _frame: &mut eframe::Frame) {
        if self.is_over() {
            ctx.send_viewport_cmd(egui::ViewportCommand::Close);
        } else if let Some(until) = self.until {
            ctx.request_repaint_after(until.saturating_duration_since(Instant::now()));
        }
    }

    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        let ctx = ui.ctx().clone();
        let status = self.status();
        let mut wishes = panels::hotkeys(&ctx, &status, &mut self.clutch_key);
        egui::Panel::left("facts")
            .exact_size(300.0)
            .resizable(false)
            .show(ui, |ui| {
                panels::facts(ui, &status, &mut wishes);
            });
        if self.open.plots {
            egui::Panel::bottom("plots")
                .exact_size(190.0)
                .resizable(false)
                .show(ui, |ui| {
                    panels::plots::show(ui, &status, &mut wishes);
                });
        }
        if self.open.slices && ctx.content_rect().width() >= 1000.0 {
            self.slices.take(&ctx, &self.session.shared().mirror());
            egui::Panel::right("slices")
                .exact_size(250.0)
                .resizable(false)
                .show(ui, |ui| self.slices.show(ui));
        }
        let size = egui::CentralPanel::no_frame().show(ui, |ui| {
            let size = self.view(ui);
            panels::overlay::show(ui, &status, &mut wishes);
            panels::gauge::show(ui, ui.max_rect(), &status);
            size
        });
        if self.help {
            panels::overlay::help(&ctx, &status, &mut self.help);
        }
        self.take_dropped(&ctx);
        for wish in wishes {
            self.obey(&ctx, wish, size.inner);
        }
        let pace = self.session.pace(self.work.min(Duration::from_millis(500)));
        *self.pace.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now() + pace;
        let behind = self.session.is_behind();
        if behind {
            ctx.request_repaint_after(pace);
        }
        self.screenshot
            .step(&ctx, self.session.camera.is_some() && !behind);
    }

    fn on_exit(&mut self) {
        self.open.view = self.session.view;
        // a layout that cannot be kept is no reason to complain at the end
        if let Some(path) = memory::path()
            && let Err(e) = memory::write(&path, &self.open)
        {
            crate::say(&format!(
                "the layout is not remembered: {}: {e}",
                path.display()
            ));
        }
        if let Some(link) = self.link.take() {
            link.flush(FAREWELL);
        }
        let of = "start of one frame to the start of the next, while pictures change";
        if let Err(e) = self.session.report(&self.args, "window", of) {
            *self.outcome.lock().unwrap_or_else(PoisonError::into_inner) = Some(e);
        }
    }
}
