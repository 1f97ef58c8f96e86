//! Shards of an image: each shard is every N-th row, and several machines render one shard each.

use super::identity::{SPEC, common, samples};
use super::{Job, Traced};
use crate::checkpoint::{Contents, Identity, Kind};
use crate::{JobError, RenderSpec};
use dapple_core::{Error, Film, Shard, ShardFilm, merge};
use std::path::{Path, PathBuf};

/// The merged film of all shards (every N-th row each) of one image, with the description of the render.
pub struct ShardSet {
    spec: RenderSpec,
    identity: Identity,
    film: Film,
    first: PathBuf,
}

/// The error for a sampler or limit that cannot be sharded.
pub(super) fn refused(shard: Shard, why: &Error) -> JobError {
    JobError::NoShard { shard, why: format!("{why} (uniform or cluster-thesis), or render in stages") }
}

impl Job {
    /// Encodes a film of this job as the bytes of a shard file.
    ///
    /// # Errors
    ///
    /// [`JobError::NoDigest`] for a scene without a digest, [`JobError::NotAShard`] for a job of the whole image,
    /// [`JobError::Core`] for the film of a stopped render.
    pub fn shard_bytes(&self, film: &Film) -> Result<Vec<u8>, JobError> {
        let shard = self.spec.shard.ok_or(JobError::NotAShard)?;
        let body = ShardFilm::new(shard, film)?.to_bytes();
        Ok(Contents { kind: Kind::Shard, identity: self.identity()?, body }.to_bytes()?)
    }

    /// Takes over the merged film of all shards, as if this job had traced it.
    ///
    /// # Errors
    ///
    /// [`JobError::OtherRender`] if the shards belong to another render than this job.
    pub fn merge(&self, shards: ShardSet) -> Result<Traced, JobError> {
        let differences = samples(&self.identity()?).differences(&samples(&shards.identity));
        if !differences.is_empty() {
            return Err(JobError::OtherRender { path: shards.first, differences });
        }
        Ok(Traced { film: shards.film, failure: None, checkpoint: None, checkpoints_written: 0 })
    }
}

impl ShardSet {
    /// Reads and merges the files of all shards of one image, in any order.
    ///
    /// # Errors
    ///
    /// [`JobError::Shards`] with a line for each file that cannot be read or does not match the others.
    /// [`JobError::Core`] for a missing or duplicate shard. [`JobError::Spec`] for a description of another version.
    pub fn read(paths: &[PathBuf]) -> Result<Self, JobError> {
        let (mut films, mut troubles) = (Vec::new(), Vec::new());
        let mut first: Option<(&Path, Identity)> = None;
        for path in paths {
            let contents = match Contents::read(path, Kind::Shard) {
                Ok(contents) => contents,
                Err(e) => {
                    troubles.push(e.to_string());
                    continue;
                }
            };
            match ShardFilm::from_bytes(&contents.body) {
                Ok(film) => films.push(film),
                Err(e) => troubles.push(format!("{}: {e}", path.display())),
            }
            match &first {
                None => first = Some((path, contents.identity)),
                Some((of, identity)) => {
                    let differ = common(identity).differences(&common(&contents.identity));
                    let of = of.display();
                    troubles.extend(
                        differ
                            .into_iter()
                            .map(|d| format!("{}: it is of another render than {of}: {d}", path.display())),
                    );
                }
            }
        }
        let Some((first, identity)) = first.filter(|_| troubles.is_empty()) else {
            return Err(JobError::Shards(troubles));
        };
        let film = merge(&films)?;
        let spec = RenderSpec::from_json(identity.value(SPEC).unwrap_or_default())?;
        // Shards have another default light selection than whole images, so the shards' selection is set explicitly.
        let spec = RenderSpec { light_selection: Some(spec.selection()), shard: None, ..spec };
        Ok(Self { spec, first: first.to_owned(), identity, film })
    }

    /// The description of a render of the whole image, read from the shards.
    pub fn spec(&self) -> &RenderSpec {
        &self.spec
    }
}
