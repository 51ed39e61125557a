//! Python bindings of ruffini.
