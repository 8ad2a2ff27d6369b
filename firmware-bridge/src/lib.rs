//! The haptics process of Osteon and everything that opens, waits or logs around the numbers.
//!
//! * [`link`]: devices on a cable; [`fake`]: a simulated one as a process of its own.
//! * [`import`]: a lab's data into a scene; [`scene`]: a bone from a scene, a CT or the built-in phantom; [`tools`]: tools from a file.
//! * [`clinic`]: plans, and sessions judged by them.
//! * [`haptics`]: the servo thread, its publisher, its sessions; [`keys`]: of viewers on other machines; [`rt`]: what it asks of the system.
//! * [`recording`]: session files; [`replay`]: playing them again; [`export`]: tables and volumes of
//!   them.
//! * [`mod@bench`]: device, cable and host in lockstep; [`launcher`]: the demonstration; [`doctor`]: what this machine can do; [`devices`]: what is plugged in; [`stop`]: how a process is asked to
//!   end.
//!
//! **Invariants.** No graphics crate and no async runtime in this crate's tree. The servo thread
//! allocates nothing, takes no lock, opens and logs nothing once it runs; nothing that a viewer does
//! reaches it but accepted requests.

pub mod bench;
pub mod clinic;
pub mod devices;
pub mod doctor;
pub mod export;
pub mod fake;
pub mod feel;
pub mod haptics;
pub mod import;
pub mod keys;
pub mod launcher;
pub mod link;
pub mod passage;
pub mod progress;
pub mod recording;
pub mod replay;
pub mod rt;
pub mod scene;
pub mod selftest;
pub mod stop;
pub mod tools;
