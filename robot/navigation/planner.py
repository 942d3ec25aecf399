"""Routes by A* on the directed graph of lanes.

A node is a place on the border between two tiles with a direction of travel; an edge is a lane
through a tile. Traffic keeps right, so the two directions over one border are two nodes and no lane
joins them: a route cannot contain a U-turn (paper A, section 3.3).
"""

import heapq
import math
from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple, Union

import numpy as np

from robot.errors import MapError, PlanError
from robot.geometry import Pose, wrap_angle
from robot.navigation.map_objects import blocked
from robot.navigation.path import Path
from robot.navigation.road_map import RoadMap, border_point

_OVERLAP_M = 0.01  # lanes this much farther than the nearest one count as near too
_TURNED_RAD = math.radians(6.0)  # likewise along the heading of a robot that stands there
STRAIGHT_RAD = -0.1  # right rather than left, where neither is straighter
RIGHT_RAD = -0.5 * math.pi
_SHORTEST = 1e-3  # of a lane: a route to where the robot already stands


@dataclass(frozen=True, eq=False)
class Route:
    """The way of fewest lanes between two places: these, and the Beziers (4, 2) to follow.

    ``cost`` counts lanes, as in the paper, the first and last by the share that is driven.
    The first and the last curve are the parts of their lanes that are driven.
    """

    lanes: Tuple[int, ...]
    curves_m: Tuple[np.ndarray, ...]
    cost: float


class LaneGraph:
    """The lanes of a road map as a directed graph; MapError where it has no road.

    ``lanes`` are those of the map, ``closed`` those, by index, that signs close or things which
    the map names; ``lane_nodes`` the nodes where each begins and ends. ``edges`` are the lanes that
    leave each node, (node at the end, lane), ``node_poses`` (nodes, 3) x [m], y [m], heading [rad].
    """

    def __init__(self, road_map: RoadMap) -> None:
        if not road_map.lanes:
            told = "add tiles such as straight/E and curve_left/N"
            raise MapError(f"{road_map.name}: expected a map with road, got none; {told}")
        self.road_map = road_map
        self.lanes, self.closed = road_map.lanes, blocked(road_map).lanes
        numbers: Dict[Tuple[int, int], int] = {}

        def node(point_m: np.ndarray) -> int:
            return numbers.setdefault(border_point(point_m, road_map.tile_size_m), len(numbers))

        control = [lane.control_points_m for lane in self.lanes]
        self.lane_nodes = tuple((node(points[0]), node(points[3])) for points in control)
        self.nodes = len(numbers)
        self.edges: List[List[Tuple[int, int]]] = [[] for _ in range(self.nodes)]
        self.node_poses = np.zeros((self.nodes, 3))
        for lane, (points, (start, end)) in enumerate(zip(control, self.lane_nodes)):
            if lane not in self.closed:
                self.edges[start].append((end, lane))
            for place, point, along in (
                (end, points[3], points[3] - points[2]),
                (start, points[0], points[1] - points[0]),
            ):
                self.node_poses[place] = (*point, math.atan2(along[1], along[0]))
        heading = self.node_poses[:, 2]
        ahead = np.stack((np.cos(heading), np.sin(heading)), axis=1)
        # the tiles that the nodes lead into
        self._tiles = np.floor(self.node_poses[:, :2] / road_map.tile_size_m + 0.25 * ahead)
        self._plans: Dict[Tuple[int, int], Tuple[int, ...]] = {}

    def plan(self, start: int, goal: int) -> Tuple[int, ...]:
        """The fewest lanes from node to node, in order, by A*; PlanError where none lead there.

        Kept, since simulated robots ask for it often.
        """
        if (start, goal) in self._plans:
            return self._plans[start, goal]
        # Each lane leads into a neighbouring tile: what is left is at least the difference in rows
        # and in columns.
        bounds = np.abs(self._tiles - self._tiles[goal]).sum(axis=1).tolist()
        reached: Dict[int, float] = {start: 0.0}
        came: Dict[int, Tuple[int, int]] = {}
        frontier = [(bounds[start], 0.0, start)]
        while frontier:
            _, minus_spent, node = heapq.heappop(frontier)
            if node == goal:
                lanes: List[int] = []
                while node != start:
                    node, lane = came[node]
                    lanes.insert(0, lane)
                self._plans[start, goal] = tuple(lanes)
                return self._plans[start, goal]
            if -minus_spent > reached[node]:
                continue
            for after, lane in self.edges[node]:
                spent = 1.0 - minus_spent
                if spent < reached.get(after, math.inf):
                    reached[after] = spent
                    came[after] = (node, lane)
                    heapq.heappush(frontier, (spent + bounds[after], -spent, after))
        places = [
            "({:.2f}, {:.2f}) m heading {:.0f} deg".format(x, y, math.degrees(heading))
            for x, y, heading in (self.node_poses[start], self.node_poses[goal])
        ]
        middles = [self.lanes[lane].pose_at(0.5) for lane in sorted(self.closed)[:3]]
        closed = "".join(f", a lane is closed at ({x:.2f}, {y:.2f}) m" for x, y, _ in middles)
        raise PlanError(
            f"{self.road_map.name}: no way from {places[0]} to {places[1]} without a U-turn"
            f"{closed}; start in the other direction or choose a destination on a lane ahead"
        )


def plan_route(graph: LaneGraph, start: Pose, goal_m: Tuple[float, float]) -> Route:
    """The cheapest route from the lane under a pose to the lane nearest to a position.

    Where lanes overlap, as at the entry of a junction, all of them are tried; a robot that has
    begun to turn there goes on as it is turned, unless no way leads on. A goal behind the robot is
    reached by driving round, since U-turns are not planned. PlanError where start or goal is not on
    the road or on a closed lane, or the goal cannot be reached.
    """
    starts = _lanes_under(graph, start.x_m, start.y_m, "start", start.heading_rad)
    goals = _lanes_under(graph, goal_m[0], goal_m[1], "goal")
    routes: List[Route] = []
    problem: Optional[PlanError] = None
    for start_lane, start_t, as_turned in starts:
        if routes and not as_turned:
            break
        for goal_lane, goal_t, _ in goals:
            try:
                routes.append(route_between(graph, start_lane, start_t, goal_lane, goal_t))
            except PlanError as error:
                problem = error
    if not routes and problem is not None:
        raise problem
    return min(routes, key=lambda route: route.cost)


def plan_path(road: Union[RoadMap, LaneGraph], start: Pose, goal_m: Tuple[float, float]) -> Path:
    """The path of `plan_route`, and its errors. Give the graph when planning often."""
    graph = road if isinstance(road, LaneGraph) else LaneGraph(road)
    return Path.from_beziers(plan_route(graph, start, goal_m).curves_m)


def path_on(graph: LaneGraph, pose: Pose, least_m: float, toward_rad: float = STRAIGHT_RAD) -> Path:
    """On from the lane under a pose, for so long if the road goes on; at junctions by the way
    whose turn is the nearest to ``toward_rad``.

    PlanError off the road or on a closed lane.
    """
    lane, t, _ = _lanes_under(graph, pose.x_m, pose.y_m, "start", pose.heading_rad)[0]
    curves = [_part(graph.lanes[lane].control_points_m, min(t, 1.0 - _SHORTEST), 1.0)]
    path = Path.from_beziers(curves)
    while path.length_m < least_m and graph.edges[graph.lane_nodes[lane][1]]:
        ways = [way for _, way in graph.edges[graph.lane_nodes[lane][1]]]
        ends = [graph.node_poses[graph.lane_nodes[way][1], 2] for way in ways]
        turned = np.asarray(wrap_angle(np.array(ends) - path.headings_rad[-1]))
        lane = ways[int(np.argmin(np.abs(turned - toward_rad)))]
        curves.append(graph.lanes[lane].control_points_m)
        path = Path.from_beziers(curves)
    return path


def _lanes_under(
    graph: LaneGraph, x_m: float, y_m: float, what: str, heading_rad: float = math.nan
) -> List[Tuple[int, float, bool]]:
    """The lanes nearest to a position, along the heading if there is one: index, parameter, and
    whether none of the others leads more as the heading does; those first."""
    road_map = graph.road_map
    near = road_map.lane_index.near(x_m, y_m)
    if not road_map.on_road(x_m, y_m):
        lane = graph.lanes[int(near.distance_m.argmin())]
        at = lane.pose_at(near.t[near.distance_m.argmin()])
        told = f"{road_map.name}: expected the {what} on the road, got ({x_m:.2f}, {y_m:.2f}) m; "
        raise PlanError(f"{told}the nearest lane is at ({at[0]:.2f}, {at[1]:.2f}) m")
    angles = np.abs(np.asarray(wrap_angle(heading_rad - near.heading_rad)))
    allowed = np.isnan(angles) | (angles <= math.pi / 2)
    if not allowed.any():
        told = f"{road_map.name}: no lane leads in the direction of the {what} at ({x_m:.2f}, "
        raise PlanError(f"{told}{y_m:.2f}) m; turn the robot along the road")
    distance_m = np.where(allowed, near.distance_m, math.inf)
    lanes = np.flatnonzero(distance_m <= distance_m.min() + _OVERLAP_M)
    lanes = lanes[~np.isin(lanes, list(graph.closed))]
    if not len(lanes):
        told = f"({x_m:.2f}, {y_m:.2f}) m, where something stands in the lane"
        raise PlanError(f"{road_map.name}: expected the {what} on an open lane, got {told}")
    angles = np.nan_to_num(angles[lanes])
    as_turned = angles <= angles.min() + _TURNED_RAD
    found = zip(lanes.tolist(), near.t[lanes].tolist(), as_turned.tolist())
    return sorted(found, key=lambda lane: not lane[2])


def route_between(
    graph: LaneGraph, start_lane: int, start_t: float, goal_lane: int, goal_t: float
) -> Route:
    """The cheapest route from a point on one lane to a point on another; PlanError if none leads.

    Lanes are indices into ``graph.lanes``; points on them are parameters of the Bezier, 0 to 1.
    """
    first, last = (graph.lanes[lane].control_points_m for lane in (start_lane, goal_lane))
    if start_lane == goal_lane and goal_t > start_t - _SHORTEST:
        end_t = min(max(goal_t, start_t + _SHORTEST), 1.0)
        return Route((start_lane,), (_part(first, min(start_t, end_t - _SHORTEST), end_t),), 0.0)
    plan = graph.plan(graph.lane_nodes[start_lane][1], graph.lane_nodes[goal_lane][0])
    lanes = [*plan, goal_lane]
    curves = [graph.lanes[lane].control_points_m for lane in plan]
    curves.append(_part(last, 0.0, max(goal_t, _SHORTEST)))
    driven = goal_t
    if start_t < 1.0 - _SHORTEST:
        lanes.insert(0, start_lane)
        curves.insert(0, _part(first, start_t, 1.0))
        driven += 1.0 - start_t
    return Route(tuple(lanes), tuple(curves), len(plan) + driven)


def _part(control: np.ndarray, t0: float, t1: float) -> np.ndarray:
    """The control points (4, 2) of a Bezier between two of its parameters (its blossom)."""
    points = []
    for triple in ((t0, t0, t0), (t0, t0, t1), (t0, t1, t1), (t1, t1, t1)):
        level = control
        for t in triple:
            level = (1.0 - t) * level[:-1] + t * level[1:]
        points.append(level[0])
    return np.array(points)
