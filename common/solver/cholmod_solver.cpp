#include "solver/cholmod_solver.hpp"

#include <cholmod.h>

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <vector>

// Only OpenBLAS has this function. Other BLAS libraries read the number of threads from environment variables.
extern "C" void openblas_set_num_threads(int count) __attribute__((weak));

namespace softhand {

struct CholmodSolver::Workspace {
  cholmod_common common{};
  cholmod_sparse* matrix = nullptr;  // lower triangle by scalar columns
  cholmod_factor* factor = nullptr;
  cholmod_dense* solution = nullptr;  // reused by cholmod_solve2, like the two below
  cholmod_dense* scratch_y = nullptr;
  cholmod_dense* scratch_e = nullptr;
  std::vector<std::int32_t> gather;  // entry of the scalar matrix <- entry of the block values

  Workspace() { cholmod_start(&common); }
  ~Workspace() {
    clear();
    cholmod_finish(&common);
  }
  void clear() {
    cholmod_free_sparse(&matrix, &common);
    cholmod_free_factor(&factor, &common);
    cholmod_free_dense(&solution, &common);
    cholmod_free_dense(&scratch_y, &common);
    cholmod_free_dense(&scratch_e, &common);
  }
};

CholmodSolver::CholmodSolver(Order order) : workspace_(std::make_unique<Workspace>()) {
  if (openblas_set_num_threads != nullptr) openblas_set_num_threads(1);
  cholmod_common& c = workspace_->common;
  c.print = 0;
  c.supernodal = CHOLMOD_SUPERNODAL;
  c.final_ll = 1;
  c.nmethods = 1;
  c.method[0].ordering = order == Order::minimum_degree ? CHOLMOD_AMD : CHOLMOD_METIS;
  c.quick_return_if_not_posdef = 1;
}

CholmodSolver::~CholmodSolver() = default;

void CholmodSolver::analyze(const BlockMatrix& blocks) {
  Workspace& w = *workspace_;
  w.clear();
  w.gather.clear();
  const int size = 3 * blocks.core_count();
  const std::size_t entries =
      9 * static_cast<std::size_t>(blocks.core_blocks()) - 3 * static_cast<std::size_t>(blocks.core_count());
  w.matrix = cholmod_allocate_sparse(static_cast<std::size_t>(size), static_cast<std::size_t>(size), entries, 1, 1, -1,
                                     CHOLMOD_REAL, &w.common);
  if (w.matrix == nullptr) throw std::runtime_error("CholmodSolver: no memory for the matrix");
  auto* start = static_cast<int*>(w.matrix->p);
  auto* row = static_cast<int*>(w.matrix->i);
  w.gather.reserve(entries);
  int next = 0;
  for (int column = 0; column < size; ++column) {
    start[column] = next;
    const auto block_column = static_cast<std::size_t>(column / 3);
    for (std::int32_t k = blocks.column_start()[block_column]; k < blocks.column_start()[block_column + 1]; ++k) {
      for (int r = 0; r < 3; ++r) {
        const int scalar_row = 3 * blocks.row()[static_cast<std::size_t>(k)] + r;
        if (scalar_row < column) continue;
        row[next++] = scalar_row;
        w.gather.push_back(9 * k + 3 * (column % 3) + r);
      }
    }
  }
  start[size] = next;
  std::fill_n(static_cast<double*>(w.matrix->x), entries, 0.0);
  w.factor = cholmod_analyze(w.matrix, &w.common);
  if (w.factor == nullptr) throw std::runtime_error("CholmodSolver: analysis failed");
}

void CholmodSolver::load(const BlockMatrix& blocks) {
  const double* values = blocks.values().data();
  auto* x = static_cast<double*>(workspace_->matrix->x);
  const std::size_t entries = workspace_->gather.size();
  const std::int32_t* gather = workspace_->gather.data();
  for (std::size_t k = 0; k < entries; ++k) x[k] = values[gather[k]];
}

bool CholmodSolver::factorize() {
  Workspace& w = *workspace_;
  w.common.status = CHOLMOD_OK;
  return cholmod_factorize(w.matrix, w.factor, &w.common) != 0 && w.common.status == CHOLMOD_OK &&
         w.factor->minor == w.factor->n;
}

bool CholmodSolver::apply(int system, const double* from, int columns) {
  Workspace& w = *workspace_;
  cholmod_dense b{};
  b.nrow = b.d = w.factor->n;
  b.ncol = static_cast<std::size_t>(columns);
  b.nzmax = b.nrow * b.ncol;
  b.x = const_cast<double*>(from);  // CHOLMOD reads it only
  b.xtype = CHOLMOD_REAL;
  b.dtype = CHOLMOD_DOUBLE;
  return cholmod_solve2(system, w.factor, &b, nullptr, &w.solution, nullptr, &w.scratch_y, &w.scratch_e, &w.common) !=
         0;
}

const double* CholmodSolver::solution() const { return static_cast<const double*>(workspace_->solution->x); }

void CholmodSolver::solve(const VectorX& rhs, VectorX& x) {
  const auto size = static_cast<std::ptrdiff_t>(workspace_->factor->n);
  if (!apply(CHOLMOD_A, rhs.data(), 1)) {
    x.setConstant(std::numeric_limits<double>::quiet_NaN());  // the caller checks directions for finite numbers
    return;
  }
  std::copy_n(solution(), size, x.data());
}

void CholmodSolver::half_solve(int first, int second, const VectorX& from, VectorX& to) {
  const auto size = static_cast<Eigen::Index>(workspace_->factor->n);
  if (apply(first, from.data(), 1)) {
    scratch_ = Eigen::Map<const VectorX>(solution(), size);
    if (apply(second, scratch_.data(), 1)) {
      to.head(size) = Eigen::Map<const VectorX>(solution(), size);
      return;
    }
  }
  to.setConstant(std::numeric_limits<double>::quiet_NaN());
}

void CholmodSolver::forward(const VectorX& rhs, VectorX& half) { half_solve(CHOLMOD_P, CHOLMOD_L, rhs, half); }

void CholmodSolver::backward(const VectorX& half, VectorX& x) { half_solve(CHOLMOD_Lt, CHOLMOD_Pt, half, x); }

void CholmodSolver::forward_columns(std::span<const ColumnsRow> rows, HalfColumns& half) {
  const auto size = static_cast<Eigen::Index>(workspace_->factor->n);
  half.ranges.assign(1, {0, static_cast<std::int32_t>(size)});
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(size, kColumns);
  for (const ColumnsRow& row : rows) columns.middleRows<3>(3 * row.block) += row.values;
  for (const int system : {CHOLMOD_P, CHOLMOD_L}) {
    if (apply(system, columns.data(), kColumns)) {
      columns = Eigen::Map<const Eigen::MatrixXd>(solution(), size, kColumns);
    } else {
      columns.setConstant(std::numeric_limits<double>::quiet_NaN());
    }
  }
  half.values = columns;
}

}  // namespace softhand
