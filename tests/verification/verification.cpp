#include "verification/verification.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <stdexcept>

#include "verification/cases.hpp"

namespace softhand::verification {

double Parameters::operator[](const std::string& key) const {
  const auto found = values_.find(key);
  if (found == values_.end()) throw std::out_of_range("no parameter '" + key + "'");
  return found->second;
}

void Parameters::set(const std::string& key, double value) {
  const auto found = values_.find(key);
  if (found == values_.end()) {
    std::string known;
    for (const auto& [name, unused] : values_) known += (known.empty() ? "" : ", ") + name;
    throw std::invalid_argument("no parameter '" + key + "'; known: " + (known.empty() ? "none" : known));
  }
  found->second = value;
}

Parameters Parameters::with(const std::string& key, double value) const {
  Parameters more = *this;
  more.values_[key] = value;
  return more;
}

bool Parameters::include(const Parameters& others) const {
  return std::all_of(others.values_.begin(), others.values_.end(), [this](const auto& other) {
    const auto found = values_.find(other.first);
    return found != values_.end() && found->second == other.second;
  });
}

bool Row::passed() const {
  const Measurement& m = measurement;
  // The condition is negated so that NaN fails.
  if (!error.empty() || !(std::abs(m.value - m.reference) <= m.tolerance)) return false;
  return !m.order || std::abs(m.order->observed - m.order->expected) <= m.order->tolerance;
}

const std::vector<Case>& all_cases() {
  static const std::vector<Case> all = [] {
    std::vector<Case> list;
    for (const auto& part :
         {material_cases(), balance_cases(), bending_cases(), indentation_cases(), body_cases(), contact_cases(),
          layer_cases(), grasp_cases(), hand_cases(), soft_cases(), two_hands_cases()}) {
      list.insert(list.end(), part.begin(), part.end());
    }
    return list;
  }();
  return all;
}

std::vector<Row> run(const Case& which, bool quick) {
  std::vector<Row> rows;
  const std::size_t count = quick ? std::min(which.quick_rows, which.table.size()) : which.table.size();
  for (std::size_t i = 0; i < count; ++i) {
    const auto started = std::chrono::steady_clock::now();
    std::vector<Measurement> measurements;
    std::string error;
    try {
      measurements = which.run(which.table[i]);
    } catch (const std::exception& thrown) {
      measurements.assign(1, {});
      measurements.front().quantity = which.name;
      error = thrown.what();
    }
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
    for (Measurement& m : measurements) {
      std::string reason;
      for (const KnownFailure& known : which.known_failures) {
        if (known.quantity == m.quantity && which.table[i].include(known.where)) reason = known.reason;
      }
      rows.push_back({which.name, which.statement, which.table[i], std::move(m), seconds, error, reason});
    }
  }
  return rows;
}

}  // namespace softhand::verification
