//! `tessera soak`: a great many samples of everything, each looked at, and none may be other than a finite
//! radiance of 0 or more.
//!
//! It renders the scenes it is given and the [hostile](hostile) ones it makes, each by every value of every
//! method's choices, and looks at samples one by one, before a sum could hide them. What it counts it has
//! rendered: a soak that looked at fewer samples than were asked for fails, as does a made scene without light.
//! It knows nothing of the farm.

mod command;
mod hostile;
mod methods;
mod run;

#[cfg(test)]
mod tests;

pub use command::{SoakArgs, command};
