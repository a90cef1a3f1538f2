//! Parameters of a network, in files.

use super::store::Store;
use crate::nn::Params;

/// Reads all parameters, whose tensors have been checked to be there.
pub(super) fn read_params(store: &Store, prefix: &str, params: &mut Params) {
    let ids: Vec<_> = params.iter().map(|(id, name, _)| (id, format!("{prefix}{name}"))).collect();
    for (id, name) in ids {
        *params.value_mut(id) = store.tensors[&name].clone();
    }
}
