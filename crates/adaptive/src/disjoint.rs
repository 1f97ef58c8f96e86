//! Sets that grow by joining.

/// Disjoint sets of numbers, by size and with halved paths [Tarjan and van Leeuwen 1984].
pub(crate) struct Disjoint {
    parent: Vec<u32>,
    size: Vec<u32>,
}

impl Disjoint {
    /// Each of `0..count` a set of its own.
    pub(crate) fn new(count: usize) -> Self {
        Self { parent: (0..count as u32).collect(), size: vec![1; count] }
    }

    /// How many numbers there are.
    pub(crate) fn len(&self) -> usize {
        self.parent.len()
    }

    /// The number that stands for the set of `i`.
    pub(crate) fn root(&mut self, mut i: usize) -> usize {
        while self.parent[i] as usize != i {
            let above = self.parent[self.parent[i] as usize];
            self.parent[i] = above;
            i = above as usize;
        }
        i
    }

    /// How many numbers the set with this root has.
    pub(crate) fn size(&self, root: usize) -> u32 {
        self.size[root]
    }

    /// Joins the sets of `a` and `b`; the root of both. The larger set's root stays, of equals the smaller number.
    pub(crate) fn join(&mut self, a: usize, b: usize) -> usize {
        let (a, b) = (self.root(a), self.root(b));
        if a == b {
            return a;
        }
        let a_stays = self.size[a] > self.size[b] || (self.size[a] == self.size[b] && a < b);
        let (stays, goes) = if a_stays { (a, b) } else { (b, a) };
        self.parent[goes] = stays as u32;
        self.size[stays] += self.size[goes];
        stays
    }
}
