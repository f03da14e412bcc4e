//! The spanning tree of the network simplex: flows on its edges, potentials on its nodes.
//!
//! Edges have no capacity and run either way, so a tree edge carries a flow `>= 0` and a
//! direction. A tree is strongly feasible when every edge without flow points to the root;
//! [`SpanningTree::pivot`] keeps it so, which rules out endless cycling.

/// A node of the tree.
pub(super) type Node = u32;

const NONE: Node = Node::MAX;

/// A node's edge to its parent and its position in the tree.
#[derive(Debug, Clone, Copy)]
struct TreeLink {
    parent: Node,
    first_child: Node,
    next_sibling: Node,
    previous_sibling: Node,
    depth: u32,
    /// Whether the flow runs from this node to the parent.
    is_up: bool,
    cost: i64,
    flow: i64,
}

/// A rooted spanning tree with a feasible flow.
#[derive(Debug)]
pub(super) struct SpanningTree {
    links: Vec<TreeLink>,
    potentials: Vec<i64>,
    root: Node,
    stack: Vec<Node>,
}

/// Matches two lists of open masses, each of one sign; the rest stays in the first. Returns the
/// cost.
fn ship(
    open: &mut Vec<(Node, i64)>,
    mut more: Vec<(Node, i64)>,
    length: &impl Fn(Node, Node) -> f64,
) -> f64 {
    if more.len() > open.len() {
        std::mem::swap(open, &mut more);
    }
    let mut cost = 0.0;
    for (node, mut mass) in more {
        while let Some((other, rest)) = open.last_mut() {
            if (*rest > 0) == (mass > 0) {
                break;
            }
            let amount = rest.abs().min(mass.abs());
            cost += amount as f64 * length(node, *other);
            mass -= amount * mass.signum();
            *rest -= amount * rest.signum();
            if *rest == 0 {
                open.pop();
            }
            if mass == 0 {
                break;
            }
        }
        if mass != 0 {
            open.push((node, mass));
        }
    }
    cost
}

impl SpanningTree {
    /// The tree with the given parents (one root), carrying `supply` (sums to zero) into balance.
    pub(super) fn feasible(
        parents: &[Option<Node>],
        supply: &[i64],
        cost: impl Fn(Node, Node) -> i64,
    ) -> Self {
        let blank = TreeLink {
            parent: NONE,
            first_child: NONE,
            next_sibling: NONE,
            previous_sibling: NONE,
            depth: 0,
            is_up: true,
            cost: 0,
            flow: 0,
        };
        let n = parents.len();
        let mut tree = Self {
            links: vec![blank; n],
            potentials: vec![0; n],
            root: 0,
            stack: Vec::with_capacity(n),
        };
        for (v, parent) in parents.iter().enumerate() {
            match *parent {
                Some(parent) => {
                    tree.links[v].cost = cost(v as Node, parent);
                    tree.attach(v as Node, parent);
                }
                None => tree.root = v as Node,
            }
        }
        tree.fill_flows(supply);
        tree.update_potentials();
        tree
    }

    /// All nodes, each after its parent.
    fn top_down(&self) -> Vec<Node> {
        let mut order = Vec::with_capacity(self.links.len());
        order.push(self.root);
        let mut next = 0;
        while let Some(&v) = order.get(next) {
            let mut child = self.links[v as usize].first_child;
            while child != NONE {
                order.push(child);
                child = self.links[child as usize].next_sibling;
            }
            next += 1;
        }
        order
    }

    /// Every edge carries the excess of the nodes below it.
    fn fill_flows(&mut self, supply: &[i64]) {
        let mut excess = supply.to_vec();
        for &v in self.top_down().iter().rev() {
            let mass = excess[v as usize];
            let link = &mut self.links[v as usize];
            link.flow = mass.abs();
            link.is_up = mass >= 0;
            if link.parent != NONE {
                excess[link.parent as usize] += mass;
            }
        }
    }

    /// The cost with every shipment in a straight line from source to sink; the flow is decomposed
    /// into shipments from the leaves up.
    pub(super) fn cost_of_straight_lines(
        &self,
        supply: &[i64],
        length: impl Fn(Node, Node) -> f64,
    ) -> f64 {
        let mut open: Vec<Vec<(Node, i64)>> = vec![Vec::new(); self.links.len()];
        let mut cost = 0.0;
        for &v in self.top_down().iter().rev() {
            if supply[v as usize] != 0 {
                let own = vec![(v, supply[v as usize])];
                cost += ship(&mut open[v as usize], own, &length);
            }
            if let Some(parent) = self.parent(v) {
                let below = std::mem::take(&mut open[v as usize]);
                cost += ship(&mut open[parent as usize], below, &length);
            }
        }
        cost
    }

    /// The node's potential: along an edge that carries flow it rises by the edge's cost.
    pub(super) fn potential(&self, v: Node) -> i64 {
        self.potentials[v as usize]
    }

    /// The node's parent; none for the root.
    pub(super) fn parent(&self, v: Node) -> Option<Node> {
        let parent = self.links[v as usize].parent;
        (parent != NONE).then_some(parent)
    }

    /// Flow times cost over all edges.
    pub(super) fn cost(&self) -> f64 {
        let edges = self.links.iter().filter(|link| link.parent != NONE);
        edges.map(|link| link.flow as f64 * link.cost as f64).sum()
    }

    /// Adds the arc `from -> to` to the tree, sends the largest feasible flow around the cycle it
    /// closes, and removes the blocking edge.
    pub(super) fn pivot(&mut self, from: Node, to: Node, cost: i64, reduced_cost: i64) {
        let (amount, leaving, leaves_on_from_side) = self.blocking_edge(from, to);
        self.send_around(from, to, amount);
        let (inner, outer) = if leaves_on_from_side { (from, to) } else { (to, from) };
        self.reattach(inner, outer, leaving, cost, amount, leaves_on_from_side);
        let shift = if leaves_on_from_side { -reduced_cost } else { reduced_cost };
        self.shift_below(inner, shift);
    }

    /// The smallest flow against the cycle's direction, and the node below that edge. Of equals it
    /// is the last from the cycle's apex in the arc's direction, which keeps the tree strongly
    /// feasible.
    fn blocking_edge(&self, from: Node, to: Node) -> (i64, Node, bool) {
        let mut least = i64::MAX;
        let mut least_from = (i64::MAX, NONE);
        let mut least_to = (i64::MAX, NONE);
        let (mut a, mut b) = (from, to);
        while a != b {
            let (link_a, link_b) = (&self.links[a as usize], &self.links[b as usize]);
            if link_a.depth >= link_b.depth {
                if link_a.is_up && link_a.flow < least_from.0 {
                    least_from = (link_a.flow, a);
                }
                a = link_a.parent;
            } else {
                if !link_b.is_up && link_b.flow <= least_to.0 {
                    least_to = (link_b.flow, b);
                }
                b = link_b.parent;
            }
        }
        least = least.min(least_from.0).min(least_to.0);
        if least_to.0 <= least { (least, least_to.1, false) } else { (least, least_from.1, true) }
    }

    /// Adds the amount to every edge of the cycle, in the cycle's direction.
    fn send_around(&mut self, from: Node, to: Node, amount: i64) {
        let (mut a, mut b) = (from, to);
        while a != b {
            if self.links[a as usize].depth >= self.links[b as usize].depth {
                let link = &mut self.links[a as usize];
                link.flow += if link.is_up { -amount } else { amount };
                a = link.parent;
            } else {
                let link = &mut self.links[b as usize];
                link.flow += if link.is_up { amount } else { -amount };
                b = link.parent;
            }
        }
    }

    /// Removes the edge above `leaving` and attaches the part below it to `outer` by `inner`,
    /// reversing the path between `inner` and `leaving`.
    fn reattach(
        &mut self,
        inner: Node,
        outer: Node,
        leaving: Node,
        cost: i64,
        flow: i64,
        is_up: bool,
    ) {
        let (mut node, mut new_parent) = (inner, outer);
        let mut edge = (cost, flow, is_up);
        loop {
            let old = self.links[node as usize];
            self.detach(node);
            let link = &mut self.links[node as usize];
            (link.cost, link.flow, link.is_up) = edge;
            self.attach(node, new_parent);
            if node == leaving {
                return;
            }
            edge = (old.cost, old.flow, !old.is_up);
            (new_parent, node) = (node, old.parent);
        }
    }

    fn attach(&mut self, v: Node, parent: Node) {
        let next = self.links[parent as usize].first_child;
        let link = &mut self.links[v as usize];
        link.parent = parent;
        link.next_sibling = next;
        link.previous_sibling = NONE;
        if next != NONE {
            self.links[next as usize].previous_sibling = v;
        }
        self.links[parent as usize].first_child = v;
    }

    fn detach(&mut self, v: Node) {
        let TreeLink { parent, next_sibling, previous_sibling, .. } = self.links[v as usize];
        if previous_sibling == NONE {
            self.links[parent as usize].first_child = next_sibling;
        } else {
            self.links[previous_sibling as usize].next_sibling = next_sibling;
        }
        if next_sibling != NONE {
            self.links[next_sibling as usize].previous_sibling = previous_sibling;
        }
    }

    /// Adds to the potentials of a subtree and updates its depths.
    fn shift_below(&mut self, top: Node, shift: i64) {
        self.stack.push(top);
        while let Some(v) = self.stack.pop() {
            self.potentials[v as usize] += shift;
            let parent = self.links[v as usize].parent;
            self.links[v as usize].depth = self.links[parent as usize].depth + 1;
            self.push_children(v);
        }
    }

    /// Depths and potentials of the whole tree from its edges.
    fn update_potentials(&mut self) {
        self.stack.push(self.root);
        while let Some(v) = self.stack.pop() {
            let link = self.links[v as usize];
            if link.parent != NONE {
                let above = self.potentials[link.parent as usize];
                self.potentials[v as usize] =
                    if link.is_up { above - link.cost } else { above + link.cost };
                self.links[v as usize].depth = self.links[link.parent as usize].depth + 1;
            }
            self.push_children(v);
        }
    }

    fn push_children(&mut self, v: Node) {
        let mut child = self.links[v as usize].first_child;
        while child != NONE {
            self.stack.push(child);
            child = self.links[child as usize].next_sibling;
        }
    }
}
