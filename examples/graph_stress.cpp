// Graph Stress: least-squares MDS (SMACOF) of the distances along the edges of a mesh, from the mesh itself.
//
//     g++ -O2 -o graph_stress graph_stress.cpp && ./graph_stress MESH.off FORM.off
#include <array>
#include <cmath>
#include <fstream>
#include <functional>
#include <iostream>
#include <limits>
#include <queue>
#include <string>
#include <utility>
#include <vector>

using Point = std::array<double, 3>;
using Entry = std::pair<double, std::size_t>;

constexpr int iterations = 100;

double distance(const Point& a, const Point& b) {
    const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return std::sqrt(x * x + y * y + z * z);
}

/// Shortest distances from one vertex along the edges (Dijkstra).
std::vector<double> distances_from(std::size_t source, const std::vector<std::vector<Entry>>& edges) {
    std::vector<double> found(edges.size(), std::numeric_limits<double>::infinity());
    std::priority_queue<Entry, std::vector<Entry>, std::greater<Entry>> queue;
    queue.push({found[source] = 0, source});
    while (!queue.empty()) {
        const auto [length, at] = queue.top();
        queue.pop();
        if (length > found[at]) continue;
        for (const auto& [edge, next] : edges[at])
            if (length + edge < found[next]) queue.push({found[next] = length + edge, next});
    }
    return found;
}

int main(int count, char** words) {
    std::ifstream in(count == 3 ? words[1] : "");
    std::string head;
    std::size_t n = 0, m = 0, unused = 0;
    in >> head >> n >> m >> unused;
    std::vector<Point> form(n);
    for (auto& [x, y, z] : form) in >> x >> y >> z;
    std::vector<std::array<std::size_t, 3>> faces(m);
    for (auto& [a, b, c] : faces) in >> unused >> a >> b >> c;
    if (!in || head != "OFF") {
        std::cerr << "usage: graph_stress MESH.off FORM.off\n";
        return 1;
    }
    std::vector<std::vector<Entry>> edges(n);
    for (const auto& face : faces)
        for (int k = 0; k < 3; ++k) {
            const std::size_t a = face[k], b = face[(k + 1) % 3];
            edges[a].push_back({distance(form[a], form[b]), b});
            edges[b].push_back({distance(form[a], form[b]), a});
        }
    std::vector<std::vector<double>> wanted;
    for (std::size_t a = 0; a < n; ++a) wanted.push_back(distances_from(a, edges));
    for (const double length : wanted[0])
        if (std::isinf(length)) {
            std::cerr << "the mesh has several components\n";
            return 2;
        }
    for (int step = 0; step < iterations; ++step) {  // the Guttman transform, with equal weights
        std::vector<Point> moved(n, Point{});
        for (std::size_t a = 0; a < n; ++a)
            for (std::size_t b = 0; b < a; ++b) {
                const double length = distance(form[a], form[b]);
                const double factor = length > 0 ? wanted[a][b] / length / n : 0;
                for (int k = 0; k < 3; ++k) {
                    const double change = factor * (form[a][k] - form[b][k]);
                    moved[a][k] += change;
                    moved[b][k] -= change;
                }
            }
        form.swap(moved);
    }
    std::ofstream out(words[2]);
    out.precision(17);
    out << "OFF\n" << n << ' ' << m << " 0\n";
    for (const auto& [x, y, z] : form) out << x << ' ' << y << ' ' << z << '\n';
    for (const auto& [a, b, c] : faces) out << "3 " << a << ' ' << b << ' ' << c << '\n';
    return out.flush() ? 0 : 1;
}
