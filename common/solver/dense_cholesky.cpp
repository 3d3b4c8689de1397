#include "solver/dense_cholesky.hpp"

#include <algorithm>
#include <cstdlib>
#include <new>

namespace softhand {

void DenseCholesky::Free::operator()(double* memory) const { std::free(memory); }

DenseCholesky::Buffer DenseCholesky::make_buffer(std::size_t count) {
  constexpr std::size_t kAlignment = 64;
  const std::size_t bytes = (count * sizeof(double) / kAlignment + 1) * kAlignment;
  Buffer buffer(static_cast<double*>(std::aligned_alloc(kAlignment, bytes)));
  if (!buffer) throw std::bad_alloc();
  std::fill_n(buffer.get(), count, 0.0);
  return buffer;
}

DenseCholesky::DenseCholesky(int most_blocks, InstructionSet set) : kernel_(cholesky_kernel<double>(set)) {
  const auto blocks = static_cast<std::size_t>(most_blocks);
  const std::size_t rows = (3 * blocks + kCholeskyTile - 1) / kCholeskyTile * kCholeskyTile;
  entries_.resize(blocks * (blocks + 1) / 2 + kCholeskyEntriesAhead);
  values_.resize(9 * entries_.size());
  panel_ = make_buffer(rows * rows);
  update_ = make_buffer(kCholeskyTile);
  inverse_diagonal_ = make_buffer(rows);
  x_ = make_buffer(rows);
  scratch_ = make_buffer(rows * kCholeskyTile);
}

void DenseCholesky::assign(const Dense& first, Eigen::Index first_size, const Dense& second, Eigen::Index second_size) {
  size_ = first_size + second_size;
  double* value = values_.data();
  const auto write = [&](const Dense& matrix, Eigen::Index row) {
    for (Eigen::Index column = 0; column <= row; column += 3, value += 9)
      Eigen::Map<Matrix3>{value} = matrix.block<3, 3>(row, column);
  };
  for (Eigen::Index row = 0; row < first_size; row += 3) write(first, row);
  for (Eigen::Index row = 0; row < second_size; row += 3) {
    std::fill_n(value, 3 * first_size, 0.0);
    value += 3 * first_size;
    write(second, row);
  }
}

void DenseCholesky::assign(std::span<const double> blocks, Eigen::Index size) {
  size_ = size;
  std::copy_n(blocks.data(), 9 * (size / 3 * (size / 3 + 1) / 2), values_.data());
}

bool DenseCholesky::factorize() {
  const auto count = static_cast<std::int32_t>(size_);
  if (front_.pivots != count) {
    front_.pivots = count;
    front_.pivot_tiles = (count + kCholeskyTile - 1) / kCholeskyTile;
    std::int32_t next = 0;
    for (std::int32_t row = 0; row < count; row += 3) {
      for (std::int32_t column = 0; column <= row; column += 3) {
        const std::int32_t tile = row / kCholeskyTile * front_.pivot_tiles * kCholeskyTile * kCholeskyTile;
        entries_[static_cast<std::size_t>(next)] = {next, tile + column * kCholeskyTile + row % kCholeskyTile};
        ++next;
      }
    }
    front_.entry_end = next;
  }
  return kernel_.factorize(plan(), 0, 1, values_.data(), panel_.get(), update_.get(), inverse_diagonal_.get());
}

void DenseCholesky::solve(Eigen::Ref<Eigen::VectorXd> x) {
  std::copy_n(x.data(), x.size(), x_.get());
  kernel_.forward(plan(), panel_.get(), inverse_diagonal_.get(), x_.get(), scratch_.get());
  kernel_.backward(plan(), panel_.get(), inverse_diagonal_.get(), x_.get(), scratch_.get());
  std::copy_n(x_.get(), x.size(), x.data());
}

double DenseCholesky::operations() const {
  const double size = front_.pivots;
  return size * (size + 1) * (2 * size + 1) / 6;
}

}  // namespace softhand
