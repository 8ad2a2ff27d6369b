//! Who is in control: at most one viewer, and it changes only by rules that can be said in a line
//! each.
//!
//! * The first that may and joins gets it; so does one that joins while the one in control is away.
//! * Who asks gets it at once where nobody has it, where the one in control is away or takes no bytes,
//!   or where a trainer asks a trainee. Else the one in control is told, and hands over or does not.
//! * A projector never gets it.

use osteon_protocol::ipc::Role;

/// What matters of a viewer here.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Standing {
    pub number: u16,
    pub role: Role,
    /// It was granted that it may be in control.
    pub may: bool,
    pub present: bool,
    /// It has taken no byte for a while although some wait.
    pub stuck: bool,
}

impl Standing {
    fn at_work(self) -> bool {
        self.present && !self.stuck
    }
}

/// Who is in control, and who asks for it.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Control {
    pub holder: Option<u16>,
    pub asking: Option<u16>,
}

impl Control {
    pub(crate) fn is_held_by(self, number: u16) -> bool {
        self.holder == Some(number)
    }

    /// A viewer has joined; `holder` is how the one in control stands.
    pub(crate) fn joined(&mut self, who: Standing, holder: Option<Standing>) {
        if who.may && holder.is_none_or(|h| !h.present) {
            self.give(who.number);
        }
    }

    /// A viewer asks for control.
    pub(crate) fn asked(&mut self, who: Standing, holder: Option<Standing>) -> Result<(), String> {
        if !who.may {
            return Err(format!(
                "this viewer joined as {} without control; start it with --role trainee or trainer",
                who.role.name()
            ));
        }
        let at_once = match holder {
            None => true,
            Some(h) if h.number == who.number => return Ok(()),
            Some(h) => !h.at_work() || (who.role == Role::Trainer && h.role != Role::Trainer),
        };
        if at_once {
            self.give(who.number);
        } else {
            self.asking = Some(who.number);
        }
        Ok(())
    }

    /// `from` gives control to another viewer.
    pub(crate) fn handed_over(&mut self, from: u16, to: Option<Standing>) -> Result<(), String> {
        if !self.is_held_by(from) {
            return Err("only the viewer in control can hand it over".to_owned());
        }
        match to {
            Some(to) if to.may && to.present => {
                self.give(to.number);
                Ok(())
            }
            Some(to) => Err(format!(
                "viewer {} cannot be in control; it is {}",
                to.number,
                if to.present {
                    to.role.name()
                } else {
                    "not connected"
                }
            )),
            None => Err("there is no viewer of that number".to_owned()),
        }
    }

    /// A viewer's connection broke, or it left; who asks meanwhile gets control.
    pub(crate) fn left(&mut self, number: u16) {
        if self.asking == Some(number) {
            self.asking = None;
        }
        if self.is_held_by(number)
            && let Some(asking) = self.asking
        {
            self.give(asking);
        }
    }

    /// A viewer's seat is given up.
    pub(crate) fn gone(&mut self, number: u16) {
        self.left(number);
        if self.is_held_by(number) {
            self.holder = None;
        }
    }

    fn give(&mut self, number: u16) {
        self.holder = Some(number);
        self.asking = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn who(number: u16, role: Role) -> Standing {
        Standing {
            number,
            role,
            may: role != Role::Projector,
            present: true,
            stuck: false,
        }
    }

    #[test]
    fn the_first_that_may_gets_it_and_the_second_asks() {
        let (a, b, p) = (
            who(1, Role::Trainee),
            who(2, Role::Trainee),
            who(3, Role::Projector),
        );
        let mut control = Control::default();
        control.joined(p, None);
        assert_eq!(control.holder, None);
        control.joined(a, None);
        control.joined(b, Some(a));
        assert!(control.is_held_by(1));
        assert!(control.asked(b, Some(a)).is_ok());
        assert_eq!((control.holder, control.asking), (Some(1), Some(2)));
        assert!(control.asked(p, Some(a)).is_err(), "a projector");
        assert!(control.handed_over(2, Some(b)).is_err(), "not his to give");
        assert!(control.handed_over(1, Some(p)).is_err(), "to a projector");
        assert!(control.handed_over(1, None).is_err());
        assert!(control.handed_over(1, Some(b)).is_ok());
        assert_eq!((control.holder, control.asking), (Some(2), None));
    }

    #[test]
    fn a_trainer_takes_it_from_a_trainee_and_not_from_a_trainer() {
        let (a, t, u) = (
            who(1, Role::Trainee),
            who(2, Role::Trainer),
            who(3, Role::Trainer),
        );
        let mut control = Control::default();
        control.joined(a, None);
        control.joined(t, Some(a));
        assert!(control.is_held_by(1), "joining alone takes nothing");
        assert!(control.asked(t, Some(a)).is_ok());
        assert!(control.is_held_by(2));
        assert!(control.asked(u, Some(t)).is_ok());
        assert_eq!((control.holder, control.asking), (Some(2), Some(3)));
        // he goes: who asks gets it
        control.left(2);
        assert!(control.is_held_by(3));
    }

    #[test]
    fn one_that_is_away_or_reads_nothing_holds_nobody_up() {
        let (mut a, b) = (who(1, Role::Trainer), who(2, Role::Trainee));
        let mut control = Control::default();
        control.joined(a, None);
        a.stuck = true;
        assert!(control.asked(b, Some(a)).is_ok());
        assert!(control.is_held_by(2));
        let mut control = Control::default();
        control.joined(a, None);
        a.present = false;
        control.left(1);
        assert!(control.is_held_by(1), "it may come back");
        control.joined(b, Some(a));
        assert!(control.is_held_by(2));
        control.gone(2);
        assert_eq!(control.holder, None);
    }
}
