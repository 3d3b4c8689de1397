#include "solver/block_cholesky.hpp"

#include <amd.h>
#if defined(__linux__)
#include <sys/mman.h>
#endif

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <new>
#include <numeric>
#include <random>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "math/index.hpp"

namespace softhand {
namespace {

constexpr std::size_t kAlignment = 64;
constexpr std::size_t kHugePage = std::size_t{1} << 21;
constexpr std::uint8_t kAncestors = 2;  // the group of the fronts that depend on both other groups

using Index = std::int32_t;

Index tiles_of(Index scalars) { return (scalars + kCholeskyTile - 1) / kCholeskyTile; }

// Elimination order of the blocks: order[k] is eliminated k-th. Approximate minimum degree breaks ties by the numbers
// of the blocks. The numbers are shuffled with `seed` (0: not shuffled). `dense` is AMD_DENSE: blocks with more than
// `dense` times the square root of the number of blocks as neighbours come last. Negative: no block counts as dense.
std::vector<Index> minimum_degree(const BlockMatrix& matrix, double dense, std::uint32_t seed) {
  const Index count = matrix.core_count();
  std::vector<Index> label(at(count)), order(at(count)), block(at(count));
  if (order.empty()) return order;
  std::iota(label.begin(), label.end(), 0);
  if (seed > 0) {
    std::minstd_rand random(seed);
    for (std::size_t k = label.size(); k > 1; --k) std::swap(label[k - 1], label[random() % k]);
  }
  for (Index k = 0; k < count; ++k) block[at(label[at(k)])] = k;
  std::vector<Index> start{0}, row;
  for (const Index column : block) {
    for (Index k = matrix.column_start()[at(column)]; k < matrix.column_start()[at(column) + 1]; ++k)
      row.push_back(label[at(matrix.row()[at(k)])]);
    std::sort(row.begin() + start.back(), row.end());
    start.push_back(static_cast<Index>(row.size()));
  }
  double control[AMD_CONTROL];
  amd_defaults(control);
  control[AMD_DENSE] = dense;
  if (amd_order(count, start.data(), row.data(), order.data(), control, nullptr) < AMD_OK)
    throw std::runtime_error("BlockCholesky: the ordering failed");
  for (Index& k : order) k = block[at(k)];
  return order;
}

struct Supernode {
  std::vector<Index> pivots;  // blocks that it eliminates, in order
  std::vector<Index> rows;    // blocks that it updates
  std::vector<Index> children;
};

// Time of a front in cycles of the AVX-512 kernels in double, roughly measured. A column of a tile is one fused
// multiply-add.
double front_cost(std::size_t pivot_blocks, std::size_t row_blocks) {
  const double pivots = 3.0 * static_cast<double>(pivot_blocks);
  const double p = static_cast<double>(tiles_of(static_cast<Index>(3 * pivot_blocks)));
  const double q = static_cast<double>(tiles_of(static_cast<Index>(3 * row_blocks)));
  constexpr double kPerFront = 300, kPerPivotTile = 400, kPerTileClearedAndSolved = 60, kPerUpdateTile = 40;
  const double strips = 64 * (p * (p - 1) / 2 * q + (p * (p - 1) / 2 * p - p * (p - 1) * (2 * p - 1) / 6));
  return kPerFront + kPerPivotTile * p + kPerTileClearedAndSolved * p * (q + 0.5 * p) + 1.1 * strips +
         q * (q + 1) / 2 * (8.8 * pivots + kPerUpdateTile);
}

// Fraction of the cost of the whole factorisation. The update matrices of cheaper subtrees are not stored: these
// subtrees are factorised again together with their parents.
constexpr double kStoredSubtree = 0.08;

double extend_add_cost(std::size_t rows) { return 20 + 5.0 * static_cast<double>(rows * rows); }

// Columns of the factor as supernodes, children before parents. Supernodes that were merged into others are empty.
std::vector<Supernode> merged_supernodes(const BlockMatrix& matrix, const std::vector<Index>& order) {
  const Index count = matrix.core_count();
  std::vector<Index> place(at(count));
  for (Index k = 0; k < count; ++k) place[at(order[at(k)])] = k;
  // From here on, blocks are numbered by their place in `order`.
  std::vector<Supernode> nodes(at(count));
  for (Index column = 0; column < count; ++column) {
    for (Index k = matrix.column_start()[at(column)]; k < matrix.column_start()[at(column) + 1]; ++k) {
      const Index a = place[at(column)], b = place[at(matrix.row()[at(k)])];
      if (a != b) nodes[at(std::min(a, b))].rows.push_back(std::max(a, b));
    }
  }
  std::vector<Index> seen(at(count), -1);
  for (Index j = 0; j < count; ++j) {
    Supernode& node = nodes[at(j)];
    node.pivots = {j};
    seen[at(j)] = j;
    for (const Index row : node.rows) seen[at(row)] = j;
    for (const Index child : node.children) {
      for (const Index row : nodes[at(child)].rows) {
        if (std::exchange(seen[at(row)], j) != j) node.rows.push_back(row);
      }
    }
    if (node.rows.empty()) continue;
    nodes[at(*std::min_element(node.rows.begin(), node.rows.end()))].children.push_back(j);
  }
  // Bottom up, each supernode merges the child with the largest gain, until no merge gains. The result has the parent's
  // rows.
  for (Supernode& parent : nodes) {
    while (true) {
      double best_gain = 0;
      auto best = parent.children.end();
      for (auto child = parent.children.begin(); child != parent.children.end(); ++child) {
        const Supernode& c = nodes[at(*child)];
        const double gain = front_cost(c.pivots.size(), c.rows.size()) +
                            front_cost(parent.pivots.size(), parent.rows.size()) + extend_add_cost(c.rows.size()) -
                            front_cost(c.pivots.size() + parent.pivots.size(), parent.rows.size());
        if (gain > best_gain) {
          best_gain = gain;
          best = child;
        }
      }
      if (best == parent.children.end()) break;
      Supernode& child = nodes[at(*best)];
      parent.children.erase(best);
      parent.children.insert(parent.children.end(), child.children.begin(), child.children.end());
      child.pivots.insert(child.pivots.end(), parent.pivots.begin(), parent.pivots.end());
      parent.pivots = std::move(child.pivots);
      child = {};
    }
  }
  for (Supernode& node : nodes) {
    for (Index& pivot : node.pivots) pivot = order[at(pivot)];
    for (Index& row : node.rows) row = order[at(row)];
  }
  return nodes;
}

// The supernodes of the cheapest of several orderings, by the model of `front_cost`.
std::vector<Supernode> cheapest_supernodes(const BlockMatrix& matrix) {
  constexpr std::uint32_t kSeeds = 4;
  std::vector<Supernode> best;
  double least = std::numeric_limits<double>::infinity();
  for (const double dense : {10.0, -1.0}) {
    for (std::uint32_t seed = 0; seed < kSeeds; ++seed) {
      std::vector<Supernode> nodes = merged_supernodes(matrix, minimum_degree(matrix, dense, seed));
      double cost = 0;
      for (const Supernode& node : nodes) {
        if (!node.pivots.empty())
          cost += front_cost(node.pivots.size(), node.rows.size()) + extend_add_cost(node.rows.size());
      }
      if (cost < least) {
        least = cost;
        best = std::move(nodes);
      }
    }
  }
  return best;
}

struct Visit {
  Index node, depth;
  std::uint8_t group = kAncestors;
};

// The group of each node. Whole subtrees are assigned to the first two groups. The assignment minimises the cost of the
// more expensive group plus the cost of the ancestors, which depend on both groups.
std::vector<std::uint8_t> assign_groups(const std::vector<Supernode>& nodes, const std::vector<Visit>& children_first) {
  const auto own_cost = [&nodes](Index n) {
    const Supernode& node = nodes[at(n)];
    return front_cost(node.pivots.size(), node.rows.size()) + extend_add_cost(node.rows.size());
  };
  std::vector<double> cost(nodes.size(), 0);  // of a subtree
  std::vector<Index> roots;
  for (const Visit& visit : children_first) {
    cost[at(visit.node)] = own_cost(visit.node);
    for (const Index child : nodes[at(visit.node)].children) cost[at(visit.node)] += cost[at(child)];
    if (visit.depth == 0) roots.push_back(visit.node);
  }
  const auto costlier = [&cost](Index a, Index b) { return std::pair(cost[at(a)], a) > std::pair(cost[at(b)], b); };
  std::vector<Index> assigned[2], best[2];
  double ancestors = 0, least = std::numeric_limits<double>::infinity();
  constexpr std::size_t kMostSubtrees = 64;
  while (!roots.empty() && roots.size() < kMostSubtrees) {
    std::sort(roots.begin(), roots.end(), costlier);
    double load[2] = {0, 0};
    assigned[0].clear();
    assigned[1].clear();
    for (const Index root : roots) {
      const int lighter = load[1] < load[0] ? 1 : 0;
      load[lighter] += cost[at(root)];
      assigned[lighter].push_back(root);
    }
    if (ancestors + std::max(load[0], load[1]) < least) {
      least = ancestors + std::max(load[0], load[1]);
      std::copy(std::begin(assigned), std::end(assigned), std::begin(best));
    }
    // Replace the most expensive subtree by its children.
    const Index costliest = roots.front();
    ancestors += own_cost(costliest);
    roots.erase(roots.begin());
    roots.insert(roots.end(), nodes[at(costliest)].children.begin(), nodes[at(costliest)].children.end());
  }
  std::vector<std::uint8_t> group(nodes.size(), kAncestors);
  for (std::uint8_t g = 0; g < 2; ++g) {
    std::vector<Index> pending = best[g];
    while (!pending.empty()) {
      const Index n = pending.back();
      pending.pop_back();
      group[at(n)] = g;
      pending.insert(pending.end(), nodes[at(n)].children.begin(), nodes[at(n)].children.end());
    }
  }
  return group;
}

// Sorted by group. In each group, children come before parents, and each subtree is contiguous.
std::vector<Visit> elimination_order(const std::vector<Supernode>& nodes) {
  std::vector<Visit> pending, result;
  std::vector<bool> is_child(nodes.size(), false);
  for (const Supernode& node : nodes) {
    for (const Index child : node.children) is_child[at(child)] = true;
  }
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    if (!nodes[n].pivots.empty() && !is_child[n]) pending.push_back({static_cast<Index>(n), 0});
  }
  while (!pending.empty()) {  // parents before children, reversed at the end
    const Visit visit = pending.back();
    pending.pop_back();
    result.push_back(visit);
    for (const Index child : nodes[at(visit.node)].children) pending.push_back({child, visit.depth + 1});
  }
  std::reverse(result.begin(), result.end());
  const std::vector<std::uint8_t> group = assign_groups(nodes, result);
  for (Visit& visit : result) visit.group = group[at(visit.node)];
  std::stable_sort(result.begin(), result.end(), [](const Visit& a, const Visit& b) { return a.group < b.group; });
  return result;
}

}  // namespace

template <typename Scalar>
void BlockCholesky<Scalar>::Free::operator()(Scalar* memory) const {
  std::free(memory);
}

template <typename Scalar>
typename BlockCholesky<Scalar>::Buffer BlockCholesky<Scalar>::make_buffer(std::size_t count) {
  const std::size_t bytes = (count + kAlignment) * sizeof(Scalar);
  const std::size_t alignment = bytes >= kHugePage / 2 ? kHugePage : kAlignment;
  const std::size_t rounded = (bytes + alignment - 1) / alignment * alignment;
  Buffer buffer(static_cast<Scalar*>(std::aligned_alloc(alignment, rounded)));
  if (!buffer) throw std::bad_alloc();
#if defined(__linux__)
  // A factor has some megabytes and is read front by front. With small pages, address translation costs a tenth of the
  // time. This is only a hint: if the kernel refuses it, the result is the same.
  if (alignment == kHugePage) madvise(buffer.get(), rounded, MADV_HUGEPAGE);
#endif
  std::fill_n(buffer.get(), count, Scalar(0));  // page faults happen here and not in the first step
  return buffer;
}

template <typename Scalar>
BlockCholesky<Scalar>::BlockCholesky(InstructionSet set, HelperThread* helper)
    : kernel_(cholesky_kernel<Scalar>(set)), helper_(helper) {}

template <typename Scalar>
void BlockCholesky<Scalar>::analyze(const BlockMatrix& matrix) {
  std::vector<Supernode> nodes = cheapest_supernodes(matrix);
  const std::vector<Visit> visits = elimination_order(nodes);
  const Index count = matrix.core_count();

  position_.assign(at(count), 0);
  front_of_block_.assign(at(count), 0);
  std::vector<Index> front_of_node(nodes.size());
  fronts_.assign(visits.size(), {});
  child_.clear();
  row_position_.clear();
  Index next = 0;
  group_.fill(0);
  for (const Visit& visit : visits) ++group_[visit.group + std::size_t{1}];
  std::partial_sum(group_.begin(), group_.end(), group_.begin());
  for (std::size_t f = 0; f < visits.size(); ++f) {
    const Supernode& node = nodes[at(visits[f].node)];
    fronts_[f].first_pivot = next;
    for (const Index block : node.pivots) {
      position_[at(block)] = next;
      front_of_block_[at(block)] = static_cast<Index>(f);
      next += 3;
    }
    front_of_node[at(visits[f].node)] = static_cast<Index>(f);
  }

  std::int64_t panel_size = 0, update_size = 0;
  // Each group has two stacks of update matrices, for even and odd depths. The update of a front is written while those
  // of its children exist. The updates of large subtrees have their own memory, so that they persist after the
  // factorisation.
  std::int64_t top[3][2] = {}, highest[3][2] = {};
  std::vector<double> cost(visits.size(), 0.0);  // of the front's subtree
  stores_update_.assign(visits.size(), 0);
  for (std::size_t f = 0; f < visits.size(); ++f) {
    const Supernode& node = nodes[at(visits[f].node)];
    cost[f] += front_cost(node.pivots.size(), node.rows.size()) + extend_add_cost(node.rows.size());
    for (const Index child : node.children) cost[f] += cost[at(front_of_node[at(child)])];
  }
  double total_cost = 0;
  for (std::size_t f = 0; f < visits.size(); ++f) total_cost += visits[f].depth == 0 ? cost[f] : 0.0;
  Index longest = 0;
  operations_ = 0;
  front_operations_.assign(visits.size(), 0.0);
  for (std::size_t f = 0; f < visits.size(); ++f) {
    Supernode& node = nodes[at(visits[f].node)];
    CholeskyFront& front = fronts_[f];
    front.pivots = 3 * static_cast<Index>(node.pivots.size());
    front.rows = 3 * static_cast<Index>(node.rows.size());
    front.pivot_tiles = tiles_of(front.pivots);
    front.row_tiles = tiles_of(front.rows);
    longest = std::max(longest, front.pivot_tiles + front.row_tiles);
    front.panel = panel_size;
    panel_size += static_cast<std::int64_t>(front.pivot_tiles + front.row_tiles) * front.pivot_tiles * kCholeskyTile *
                  kCholeskyTile;
    front.row_begin = static_cast<Index>(row_position_.size());
    for (const Index row : node.rows) row_position_.push_back(position_[at(row)]);
    std::sort(row_position_.begin() + front.row_begin, row_position_.end());
    front.child_begin = static_cast<Index>(child_.size());
    for (const Index child : node.children) child_.push_back(front_of_node[at(child)]);
    std::sort(child_.begin() + front.child_begin, child_.end());
    front.child_end = static_cast<Index>(child_.size());

    const std::uint8_t group = visits[f].group;
    const int parity = visits[f].depth % 2;
    const std::int64_t size =
        static_cast<std::int64_t>(front.row_tiles) * front.row_tiles * kCholeskyTile * kCholeskyTile;
    if (cost[f] >= kStoredSubtree * total_cost) {
      stores_update_[f] = 1;
      front.update = update_size;
      update_size += size;
    } else {
      front.update = top[group][parity];
      top[group][parity] += size;
      highest[group][parity] = std::max(highest[group][parity], top[group][parity]);
    }
    // The updates of its children are no longer needed: pop them. The updates of the two groups' subtrees stay at the
    // bottom of their groups' stacks.
    for (Index k = front.child_begin; k < front.child_end; ++k) {
      const std::size_t child = at(child_[at(k)]);
      if (visits[child].group != group || stores_update_[child] != 0) continue;
      top[group][1 - parity] = fronts_[child].update;
      break;
    }
    for (Index p = 0; p < front.pivots; ++p) {
      const double length = front.pivots + front.rows - p;
      front_operations_[f] += length * (length + 1);
    }
    operations_ += front_operations_[f];
  }
  std::int64_t stack[3][2];
  for (int group = 0; group < 3; ++group) {
    for (int parity = 0; parity < 2; ++parity) {
      stack[group][parity] = update_size;
      update_size += highest[group][parity];
    }
  }
  for (std::size_t f = 0; f < visits.size(); ++f) {
    if (stores_update_[f] == 0) fronts_[f].update += stack[visits[f].group][visits[f].depth % 2];
  }

  const auto panel_row = [](const CholeskyFront& front, const Index* rows, Index position) {
    if (position < front.first_pivot + front.pivots) return position - front.first_pivot;
    const Index* const begin = rows + front.row_begin;
    return kCholeskyTile * front.pivot_tiles +
           3 * static_cast<Index>(std::lower_bound(begin, begin + front.rows / 3, position) - begin);
  };
  row_in_parent_.assign(row_position_.size(), 0);
  tile_rows_.clear();
  for (const CholeskyFront& parent : fronts_) {
    for (Index k = parent.child_begin; k < parent.child_end; ++k) {
      CholeskyFront& child = fronts_[at(child_[at(k)])];
      for (Index b = 0; b < child.rows / 3; ++b) {
        row_in_parent_[at(child.row_begin + b)] =
            panel_row(parent, row_position_.data(), row_position_[at(child.row_begin + b)]);
      }
      child.tile_begin = static_cast<Index>(tile_rows_.size());
      for (Index r = 0; r < child.rows; ++r) {
        const Index row = row_in_parent_[at(child.row_begin + r / 3)] + r % 3;
        if (r == 0 || tile_rows_.back().tile != row / kCholeskyTile) tile_rows_.push_back({row / kCholeskyTile, r, 0});
        tile_rows_.back().rows |= 1u << (row % kCholeskyTile);
      }
      child.tile_end = static_cast<Index>(tile_rows_.size());
    }
  }

  struct Entry {
    Index front, column, row, source;
  };
  std::vector<Entry> entries;
  front_of_stored_.assign(at(matrix.core_blocks()), 0);
  for (Index column = 0; column < count; ++column) {
    for (Index k = matrix.column_start()[at(column)]; k < matrix.column_start()[at(column) + 1]; ++k) {
      const Index row = matrix.row()[at(k)];
      const bool transposed = position_[at(row)] < position_[at(column)];
      const Index low = transposed ? row : column, high = transposed ? column : row;
      const Index f = front_of_block_[at(low)];
      const CholeskyFront& front = fronts_[at(f)];
      front_of_stored_[at(k)] = f;
      entries.push_back({f, position_[at(low)] - front.first_pivot,
                         panel_row(front, row_position_.data(), position_[at(high)]), transposed ? ~k : k});
    }
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return std::tie(a.front, a.column, a.row) < std::tie(b.front, b.column, b.row);
  });
  entries_.clear();
  for (const Entry& entry : entries) {
    CholeskyFront& front = fronts_[at(entry.front)];
    if (front.entry_end == 0) front.entry_begin = static_cast<Index>(entries_.size());
    const Index tile = entry.row / kCholeskyTile * front.pivot_tiles * kCholeskyTile * kCholeskyTile;
    entries_.push_back({entry.source, tile + entry.column * kCholeskyTile + entry.row % kCholeskyTile});
    front.entry_end = static_cast<Index>(entries_.size());
  }
  entries_.resize(entries_.size() + kCholeskyEntriesAhead);

  stale_.assign(fronts_.size(), 1);
  has_updates_ = false;
  const std::size_t unknowns = 3 * at(count);
  panel_size_ = static_cast<std::size_t>(panel_size);
  panels_ = make_buffer(panel_size_);
  update_size_ = static_cast<std::size_t>(update_size);
  updates_ = make_buffer(update_size_ + kCholeskyTile);
  inverse_diagonal_ = make_buffer(unknowns);
  x_ = make_buffer(unknowns);
  scratch_ = make_buffer(at(longest * kCholeskyTile * kCholeskyTile));
  columns_ = make_buffer(unknowns * kColumns);
  included_.assign(fronts_.size(), 0);
}

template <typename Scalar>
void BlockCholesky<Scalar>::load(const BlockMatrix& matrix) {
  values_ = matrix.values().data();
}

template <typename Scalar>
CholeskyPlan BlockCholesky<Scalar>::plan() const {
  return {fronts_.data(),        fronts_.size(),  child_.data(),    row_position_.data(),
          row_in_parent_.data(), entries_.data(), tile_rows_.data()};
}

template <typename Scalar>
bool BlockCholesky<Scalar>::factorize() {
  std::fill(stale_.begin(), stale_.end(), 1);
  return factorize_stale();
}

template <typename Scalar>
bool BlockCholesky<Scalar>::refactorize(std::span<const std::int32_t> changed) {
  if (!has_updates_) return factorize();
  std::fill(stale_.begin(), stale_.end(), 0);
  for (const std::int32_t block : changed) {
    if (at(block) < front_of_stored_.size()) stale_[at(front_of_stored_[at(block)])] = 1;
  }
  for (std::size_t f = 0; f < fronts_.size(); ++f) {
    for (Index k = fronts_[f].child_begin; k < fronts_[f].child_end; ++k) stale_[f] |= stale_[at(child_[at(k)])];
  }
  // The updates of small subtrees are not stored: factorise these subtrees again below each stale front.
  for (std::size_t f = fronts_.size(); f-- > 0;) {
    for (Index k = fronts_[f].child_begin; k < fronts_[f].child_end; ++k) {
      if (stores_update_[at(child_[at(k)])] == 0) stale_[at(child_[at(k)])] |= stale_[f];
    }
  }
  return factorize_stale();
}

template <typename Scalar>
bool BlockCholesky<Scalar>::factorize_stale() {
  bool one = false, other = false;
  run_halves(
      helper_, [&] { one = factorize_stale(0); }, [&] { other = factorize_stale(1); });
  has_updates_ = one && other && factorize_stale(kAncestors);
  return has_updates_;
}

template <typename Scalar>
bool BlockCholesky<Scalar>::factorize_stale(int group) {
  const auto begin = stale_.begin() + static_cast<std::ptrdiff_t>(group_[at(group)]),
             end = stale_.begin() + static_cast<std::ptrdiff_t>(group_[at(group + 1)]);
  for (auto first = std::find(begin, end, 1); first != end;) {
    const auto last = std::find(first, end, 0);
    if (!kernel_.factorize(plan(), static_cast<std::size_t>(first - stale_.begin()),
                           static_cast<std::size_t>(last - stale_.begin()), values_, panels_.get(), updates_.get(),
                           inverse_diagonal_.get())) {
      return false;
    }
    first = std::find(last, end, 1);
  }
  return true;
}

template <typename Scalar>
double BlockCholesky<Scalar>::last_operations() const {
  double operations = 0;
  for (std::size_t f = 0; f < stale_.size(); ++f) operations += stale_[f] != 0 ? front_operations_[f] : 0.0;
  return operations;
}

template <typename Scalar>
void BlockCholesky<Scalar>::solve(const VectorX& rhs, VectorX& x) {
  permute(rhs);
  kernel_.forward(plan(), panels_.get(), inverse_diagonal_.get(), x_.get(), scratch_.get());
  kernel_.backward(plan(), panels_.get(), inverse_diagonal_.get(), x_.get(), scratch_.get());
  permute_back(x);
}

template <typename Scalar>
void BlockCholesky<Scalar>::forward(const VectorX& rhs, VectorX& half) {
  permute(rhs);
  kernel_.forward(plan(), panels_.get(), inverse_diagonal_.get(), x_.get(), scratch_.get());
  for (std::size_t i = 0; i < 3 * position_.size(); ++i) half[static_cast<Eigen::Index>(i)] = x_[i];
}

template <typename Scalar>
void BlockCholesky<Scalar>::backward(const VectorX& half, VectorX& x) {
  for (std::size_t i = 0; i < 3 * position_.size(); ++i)
    x_[i] = static_cast<Scalar>(half[static_cast<Eigen::Index>(i)]);
  kernel_.backward(plan(), panels_.get(), inverse_diagonal_.get(), x_.get(), scratch_.get());
  permute_back(x);
}

template <typename Scalar>
void BlockCholesky<Scalar>::forward_columns(std::span<const ColumnsRow> rows, HalfColumns& half) {
  static_assert(kColumns == kCholeskyTile);
  std::fill(included_.begin(), included_.end(), 0);
  for (const ColumnsRow& row : rows) included_[at(front_of_block_[at(row.block)])] = 1;
  half.ranges.clear();
  for (std::size_t f = 0; f < fronts_.size(); ++f) {
    const CholeskyFront& front = fronts_[f];
    for (Index k = front.child_begin; k < front.child_end; ++k) included_[f] |= included_[at(child_[at(k)])];
    if (included_[f] == 0) continue;
    const Index begin = front.first_pivot, end = begin + front.pivots;
    std::fill(columns_.get() + kColumns * at(begin), columns_.get() + kColumns * at(end), Scalar(0));
    if (!half.ranges.empty() && half.ranges.back().second == begin) {
      half.ranges.back().second = end;
    } else {
      half.ranges.push_back({begin, end});
    }
  }
  for (const ColumnsRow& row : rows) {
    Scalar* const to = columns_.get() + kColumns * at(position_[at(row.block)]);
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < kColumns; ++c) to[kColumns * r + c] += static_cast<Scalar>(row.values(r, c));
    }
  }
  kernel_.forward_columns(plan(), included_.data(), panels_.get(), inverse_diagonal_.get(), columns_.get(),
                          scratch_.get());
  for (const auto& [begin, end] : half.ranges) {
    const Scalar* from = columns_.get() + kColumns * at(begin);
    for (Index row = begin; row < end; ++row) {
      for (int c = 0; c < kColumns; ++c) half.values(row, c) = *from++;
    }
  }
}

// `x_` in elimination order from and to the order of the matrix.
template <typename Scalar>
void BlockCholesky<Scalar>::permute(const VectorX& rhs) {
  for (std::size_t block = 0; block < position_.size(); ++block) {
    for (std::size_t k = 0; k < 3; ++k)
      x_[at(position_[block]) + k] = static_cast<Scalar>(rhs[static_cast<Eigen::Index>(3 * block + k)]);
  }
}

template <typename Scalar>
void BlockCholesky<Scalar>::permute_back(VectorX& x) const {
  for (std::size_t block = 0; block < position_.size(); ++block) {
    for (std::size_t k = 0; k < 3; ++k)
      x[static_cast<Eigen::Index>(3 * block + k)] = static_cast<double>(x_[at(position_[block]) + k]);
  }
}

template <typename Scalar>
bool BlockCholesky<Scalar>::take_factor(const LinearSolver& other) {
  const auto* const same = dynamic_cast<const BlockCholesky*>(&other);
  if (same == nullptr || same->position_ != position_ || same->panel_size_ != panel_size_) return false;
  std::copy_n(same->panels_.get(), panel_size_, panels_.get());
  std::copy_n(same->inverse_diagonal_.get(), 3 * position_.size(), inverse_diagonal_.get());
  has_updates_ = same->has_updates_;
  if (has_updates_) std::copy_n(same->updates_.get(), update_size_, updates_.get());
  return true;
}

template class BlockCholesky<double>;
template class BlockCholesky<float>;

}  // namespace softhand
