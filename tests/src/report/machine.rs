//! The machine that a report was made on.

use serde::Serialize;

/// What a figure's reader must know of the machine.
#[derive(Debug, Clone, Serialize)]
pub struct Machine {
    /// CPU model as the system names it.
    pub cpu: String,
    /// Family and model number: a hypervisor's name may hide the model.
    pub cpu_family_model: String,
    /// Cores that this process may use.
    pub cores: usize,
    /// Vector instructions, widest last.
    pub isa: Vec<String>,
    /// The core that everything timed ran on; absent where pinning was refused.
    pub pinned_core: Option<usize>,
    /// Why not, where it was refused.
    pub not_pinned: Option<String>,
    /// Processes waiting for a core, one minute's mean, at the beginning.
    pub load_at_start: Option<f64>,
    /// The same at the end.
    pub load_at_end: Option<f64>,
    /// Reading the clock twice, ns; it is in every time.
    pub timer_ns: f64,
    /// Operating system.
    pub os: String,
}

impl Machine {
    /// Looks at this machine. `pinned` is what [`crate::measure::intrinsic::pin`] said.
    pub fn look(pinned: Result<usize, String>, timer_ns: f64) -> Self {
        let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let field = |name: &str| {
            info.lines()
                .find(|l| l.starts_with(name))
                .and_then(|l| l.split_once(':'))
                .map_or_else(|| "unknown".to_owned(), |(_, v)| v.trim().to_owned())
        };
        let flags = field("flags");
        let isa = ["sse2", "sse4_1", "avx", "avx2", "avx512f", "avx512bw"]
            .into_iter()
            .filter(|name| flags.split_whitespace().any(|f| f == *name))
            .map(str::to_owned)
            .collect();
        Self {
            cpu: field("model name"),
            cpu_family_model: format!("family {}, model {}", field("cpu family"), field("model\t")),
            cores: info.lines().filter(|l| l.starts_with("processor")).count(),
            isa,
            pinned_core: pinned.as_ref().ok().copied(),
            not_pinned: pinned.err(),
            load_at_start: load(),
            load_at_end: None,
            timer_ns,
            os: std::fs::read_to_string("/proc/sys/kernel/osrelease")
                .map_or_else(|_| "unknown".to_owned(), |s| format!("Linux {}", s.trim())),
        }
    }

    /// Notes the load at the end.
    pub fn finish(&mut self) {
        self.load_at_end = load();
    }

    /// In words, for a document.
    pub fn words(&self) -> String {
        let pinned = match (self.pinned_core, &self.not_pinned) {
            (Some(core), _) => format!("timed on core {core} alone"),
            (None, Some(why)) => why.clone(),
            (None, None) => "not pinned".to_owned(),
        };
        let load = |l: Option<f64>| l.map_or_else(|| "unknown".to_owned(), |l| format!("{l:.1}"));
        format!(
            "{} ({}), {} cores, {}; {}; {pinned}; load {} at the start and {} at the end; reading the \
             clock costs {:.0} ns, which is in every time",
            self.cpu,
            self.cpu_family_model,
            self.cores,
            self.isa.join(" "),
            self.os,
            load(self.load_at_start),
            load(self.load_at_end),
            self.timer_ns,
        )
    }
}

fn load() -> Option<f64> {
    std::fs::read_to_string("/proc/loadavg")
        .ok()?
        .split_whitespace()
        .next()?
        .parse()
        .ok()
}
