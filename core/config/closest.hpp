// "Did you mean": the candidate with the fewest edits from a word. World: setup and jobs.
#pragma once
#include <string>
#include <vector>

namespace wb::config {

// Empty if none is near: more than a third of the word (at least two letters) would have to change.
std::string closest(const std::string& word, const std::vector<std::string>& candidates);

}  // namespace wb::config
