//! Disjoint sets (union-find).

/// Disjoint sets of numbers, with union by size and path halving [Tarjan and van Leeuwen 1984].
pub(crate) struct Disjoint {
    parent: Vec<u32>,
    size: Vec<u32>,
}

impl Disjoint {
    /// Sets of one number each, for the numbers `0..count`.
    pub(crate) fn new(count: usize) -> Self {
        Self { parent: (0..count as u32).collect(), size: vec![1; count] }
    }

    /// The count of numbers in all sets.
    pub(crate) fn len(&self) -> usize {
        self.parent.len()
    }

    /// The root of the set that contains `i`.
    pub(crate) fn root(&mut self, mut i: usize) -> usize {
        while self.parent[i] as usize != i {
            let above = self.parent[self.parent[i] as usize];
            self.parent[i] = above;
            i = above as usize;
        }
        i
    }

    /// The size of the set whose root is `root`.
    pub(crate) fn size(&self, root: usize) -> u32 {
        self.size[root]
    }

    /// Joins the sets of `a` and `b`, and returns their common root: the root of the larger set, or the smaller root if
    /// the sizes are equal.
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
