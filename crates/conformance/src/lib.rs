//! What every Dapple point set, sampler and filter must pass, called with one line each.
