//! A store that forgets everything: for tests.
