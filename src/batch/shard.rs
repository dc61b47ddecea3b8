//! Which models belong to which machine: by a hash of the name alone, so that adding a model moves no other.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use xxhash_rust::xxh3::xxh3_64;

/// Part `index` of `count`, from 1.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct Shard {
    /// Its number, from 1
    pub(crate) index: u32,
    /// Parts that there are
    pub(crate) count: u32,
}

impl Shard {
    /// Whether a model is part of it.
    pub(crate) fn has(self, name: &str) -> bool {
        xxh3_64(name.as_bytes()) % u64::from(self.count) == u64::from(self.index - 1)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((index, count)) if (1..=count).contains(&index) => Ok(Shard { index, count }),
            _ => Err("expected I/N with I from 1 to N, as in 2/8".to_owned()),
        }
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_model_is_in_one_shard_whatever_the_others() {
        let names: Vec<String> = (0..500).map(|i| format!("scans/{i}")).collect();
        for count in [1, 2, 7] {
            let shards: Vec<Shard> = (1..=count).map(|index| Shard { index, count }).collect();
            for name in &names {
                assert_eq!(shards.iter().filter(|shard| shard.has(name)).count(), 1, "{name}");
            }
            for shard in &shards {
                let share = names.iter().filter(|name| shard.has(name)).count();
                assert!(share > 500 / count as usize / 2, "{shard}: {share}");
            }
        }
        // Stored summaries rely on it.
        assert!(Shard { index: 1, count: 2 }.has("lucy") != Shard { index: 2, count: 2 }.has("lucy"));
    }

    #[test]
    fn shards_count_from_one() {
        assert_eq!("2/8".parse(), Ok(Shard { index: 2, count: 8 }));
        for bad in ["0/4", "5/4", "1", "1/0", "a/b", "1/2/3", "-1/2"] {
            assert!(bad.parse::<Shard>().is_err(), "{bad}");
        }
    }
}
