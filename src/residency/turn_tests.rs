//! Requests that follow one another on a view, and the turn.

use super::tests::{BLOCKS, budget_for, rig};
use super::*;

/// A request takes the place of another one of its view, which has the turn and ends a little later. Wants that were
/// ranked as patient meanwhile raise the pressure, or are told that they do not fit.
#[test]
fn wants_that_were_ranked_before_the_turn_ended_are_answered() {
    for has_turn in [false, true] {
        let rig = rig(budget_for(0.3), false);
        let view = rig.residency.view();
        if has_turn {
            assert!(view.of(1).takes_turn());
        }
        view.begin_pass(true);
        let all: Vec<Wanted> = (0..BLOCKS).map(|block| rig.wanted(block, 1.0)).collect();
        view.want(&all);
        // One piece of work: the wants are ranked, and the first blocks are read.
        rig.residency.pump();
        view.of(1).end_turn();
        rig.pump_all_unchecked();
        let state = view.status().state;
        assert!(view.pressure() > 1.0 || state != ViewState::Busy, "turn {has_turn}: no block is read, and {state:?}");
    }
}

/// A request that was replaced cannot withdraw the wants of its successor, or take the turn.
#[test]
fn calls_of_earlier_requests_do_nothing() {
    let rig = rig(1 << 30, false);
    let view = rig.residency.view();
    view.of(1).begin();
    assert_ne!(view.of(1).begin_pass(true), 0);
    view.of(2).begin();
    assert_ne!(view.of(2).begin_pass(true), 0);
    view.of(2).want(&[rig.wanted(3, 1.0)]);
    view.of(1).want(&[]);
    view.of(1).rest();
    assert_eq!((view.of(1).takes_turn(), view.of(1).begin_pass(true)), (false, 0));
    assert_ne!(view.status().bytes_wanted, 0);
    assert!(view.of(2).takes_turn());
}
