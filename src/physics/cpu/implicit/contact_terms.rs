//! The contact terms among the terms of a body.

use crate::physics::cpu::contact::self_contact::SelfContactTerm;
use crate::physics::cpu::contact::tool_contact::ToolContact;
use crate::physics::cpu::scalar::Real;
use crate::physics::cpu::term::{Term, find_term, find_term_mut};

/// Returns the tool contact among the terms.
pub(in crate::physics::cpu) fn tool_contact<T: Real>(
    terms: &[Box<dyn Term<T>>],
) -> Option<&ToolContact<T>> {
    find_term(terms)
}

/// As [`tool_contact`], mutable.
pub(in crate::physics::cpu) fn tool_contact_mut<T: Real>(
    terms: &mut [Box<dyn Term<T>>],
) -> Option<&mut ToolContact<T>> {
    find_term_mut(terms)
}

/// Returns the self-contact among the terms.
pub(in crate::physics::cpu) fn self_contact<T: Real>(
    terms: &[Box<dyn Term<T>>],
) -> Option<&SelfContactTerm<T>> {
    find_term(terms)
}

/// As [`self_contact`], mutable.
pub(in crate::physics::cpu) fn self_contact_mut<T: Real>(
    terms: &mut [Box<dyn Term<T>>],
) -> Option<&mut SelfContactTerm<T>> {
    find_term_mut(terms)
}
