//! Frames and stand-ins: pictures, light, the promise of each hit, and the stability of level of detail.

mod best_stays;
mod common;
mod figures;
mod frame_requests;
mod frames;
mod lenses;
mod oracle_light;
mod oracle_pictures;
mod panes;
mod part_budgets;
mod part_colours;
mod part_looks;
mod picture_errors;
mod picture_perceived;
mod promise;
mod proxies;
mod settings;
mod shadows;
mod smooth;
mod stability;
mod tone;
mod views;
