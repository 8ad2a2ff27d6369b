//! A session without a window: drawn at a modest rate, its last state written as a PNG.
#![expect(
    clippy::cast_possible_truncation,
    reason = "lattice and picture edges are bounded far below the target type; f64 becomes f32 for the GPU"
)]

use crate::adapter;
use crate::cli::ViewArgs;
use crate::link::{Link, Shared};
use crate::mirror::End;
use crate::render::Renderer;
use crate::session::{Drawn, Manners, Session};
use anyhow::Context as _;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long the last messages may take to leave.
const FAREWELL: Duration = Duration::from_millis(500);
/// Samples along each axis of a pixel of the written picture.
const SUPERSAMPLING: u32 = 2;

/// Follows the session to its end and writes the picture.
pub(crate) fn run(
    args: &ViewArgs,
    out: &Path,
    manners: impl FnOnce(bool) -> Manners,
) -> anyhow::Result<()> {
    let gpu = adapter::open()?;
    let manners = manners(gpu.adapter.is_cpu);
    let shared = Shared::new();
    let name = format!("osteon view, offscreen, {}", gpu.adapter.name);
    let link = Link::start(&args.place(), &args.joining_unattended(&name), &shared)?;
    let renderer = Renderer::new(&gpu.device, &gpu.queue);
    let mut session = Session::new(Arc::clone(&shared), renderer, gpu.adapter, args, manners);
    follow(args, &mut session)?;
    link.flush(FAREWELL);
    last_picture(args, out, &mut session)?;
    session.report(
        args,
        "offscreen",
        "submission to completion of a frame, uploads included",
    )?;
    match &session.shared().mirror().end {
        Some(End::Failed(reason)) => anyhow::bail!("{reason}"),
        Some(End::Bye(_)) | None => Ok(()),
    }
}

fn follow(args: &ViewArgs, session: &mut Session) -> anyhow::Result<()> {
    let until = args
        .seconds
        .map(|s| Instant::now() + Duration::from_secs_f64(s));
    let mut seen = 0;
    loop {
        let begin = Instant::now();
        let size = session.scaled(args.size);
        if session.draw(size, false)? == Drawn::New {
            session.renderer.wait()?;
            session.times.push(begin.elapsed());
        }
        let over = until.is_some_and(|t| Instant::now() >= t);
        if over || session.shared().mirror().end.is_some() {
            return Ok(());
        }
        let pace = session.pace(begin.elapsed());
        std::thread::sleep(pace.saturating_sub(begin.elapsed()));
        if !session.is_behind() {
            // nothing to draw until something is sent; short, so that --seconds holds
            session.shared().wait(Duration::from_millis(100), |m| {
                m.revision != seen || m.end.is_some()
            });
        }
        seen = session.shared().mirror().revision;
    }
}

/// The last state at full size, with shadows and supersampling.
fn last_picture(args: &ViewArgs, out: &Path, session: &mut Session) -> anyhow::Result<()> {
    let fine = args.size.map(|n| n * SUPERSAMPLING);
    let most = 8192;
    let factor = if fine.into_iter().all(|n| n <= most) {
        SUPERSAMPLING
    } else {
        1
    };
    let size = args.size.map(|n| n * factor);
    session.draw(size, true)?;
    while session.is_behind() {
        session.draw(size, true)?;
    }
    if session.camera.is_none() {
        anyhow::bail!(
            "the session ended before the bone had arrived: no picture {} was written",
            out.display()
        );
    }
    let pixels = session.renderer.read()?;
    write_png(out, args.size, &average(&pixels, args.size, factor))
}

/// Averages squares of `factor`² pixels; `size` is that of the result.
fn average(pixels: &[u8], size: [u32; 2], factor: u32) -> Vec<u8> {
    let [width, height] = size.map(|n| n as usize);
    let factor = factor as usize;
    let area = (factor * factor) as u32;
    let mut out = Vec::with_capacity(4 * width * height);
    for y in 0..height {
        for x in 0..width {
            for channel in 0..4 {
                let sum: u32 = (0..factor * factor)
                    .map(|s| {
                        let (i, j) = (x * factor + s % factor, y * factor + s / factor);
                        u32::from(pixels[4 * (j * width * factor + i) + channel])
                    })
                    .sum();
                // a mean of bytes is a byte
                out.push(((sum + area / 2) / area) as u8);
            }
        }
    }
    out
}

/// Writes RGBA bytes as a PNG.
pub(crate) fn write_png(path: &Path, [width, height]: [u32; 2], rgba: &[u8]) -> anyhow::Result<()> {
    let what = || {
        format!(
            "cannot write the picture {}; choose another path",
            path.display()
        )
    };
    let file = std::fs::File::create(path).with_context(what)?;
    let mut encoder = png::Encoder::new(std::io::BufWriter::new(file), width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().with_context(what)?;
    writer.write_image_data(rgba).with_context(what)?;
    writer.finish().with_context(what)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averaging_keeps_a_flat_picture_and_the_mean_of_a_chequered_one() {
        let pixels: Vec<u8> = (0..4 * 4)
            .flat_map(|i| {
                if (i % 4 + i / 4) % 2 == 0 {
                    [200, 100, 7, 255]
                } else {
                    [100, 0, 7, 255]
                }
            })
            .collect();
        let out = average(&pixels, [2, 2], 2);
        assert_eq!(out, [150, 50, 7, 255].repeat(4));
    }
}
