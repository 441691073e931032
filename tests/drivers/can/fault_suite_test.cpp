// The fault suite (drivers/can/faults): each row of the list is a test; and the how-to's table is
// that list.
#include <gtest/gtest.h>

#include <fstream>
#include <set>
#include <string>

#include "drivers/can/faults/fault_rows.hpp"

namespace wb::can {
namespace {

class FaultSuite : public testing::TestWithParam<std::size_t> {};

TEST_P(FaultSuite, IsNoticedInTimeAndMovesNothingUntilActivated) {
  const FaultRow& row = fault_rows()[GetParam()];
  const FaultResult r = run_fault(row);
  EXPECT_TRUE(r.detected) << row.fault << ": noticed as '" << r.event << "' after "
                          << r.detection_ms << " ms, allowed are " << row.bound_ms;
  EXPECT_TRUE(r.reacted) << row.fault << ": wrong reaction";
  EXPECT_TRUE(r.latched) << row.fault << ": not latched, moved " << r.moved_rad << " rad; "
                         << r.note;
  EXPECT_TRUE(r.recovered) << row.fault << ": no way out";
  EXPECT_TRUE(r.logged) << row.fault << ": no log line";
  EXPECT_TRUE(r.counted) << row.fault << ": no counter";
}

INSTANTIATE_TEST_SUITE_P(Rows, FaultSuite, testing::Range<std::size_t>(0, fault_rows().size()),
                         [](const testing::TestParamInfo<std::size_t>& info) {
                           return "row" + fault_rows()[info.param].number;
                         });

TEST(FaultList, CoversAtLeastThirtyOfTheFortyFaultsAndNamesTheRest) {
  std::set<int> covered;
  std::set<std::string> numbers;
  for (const FaultRow& row : fault_rows()) {
    EXPECT_TRUE(numbers.insert(row.number).second) << row.number << " stands twice";
    covered.insert(std::stoi(row.number));
  }
  std::set<int> named = covered;
  for (const NotCovered& n : faults_not_covered()) named.insert(n.number);
  covered.erase(41);  // not of the list
  EXPECT_GE(covered.size(), 30u);
  for (int i = 1; i <= 40; ++i) EXPECT_TRUE(named.contains(i)) << "fault " << i << " is not named";
}

TEST(FaultList, IsTheTableOfTheHowTo) {
  std::ifstream in(std::string(WB_SOURCE_DIR) + "/docs/how-to/can.md");
  const std::string page{std::istreambuf_iterator<char>(in), {}};
  EXPECT_NE(page.find(fault_table()), std::string::npos)
      << "docs/how-to/can.md does not hold the present table; it is:\n"
      << fault_table();
}

}  // namespace
}  // namespace wb::can
