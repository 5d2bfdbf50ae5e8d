"""Methods and scorers by name: those of the suite and of plugin files."""

from benchmark.registry.components import Component as Component
from benchmark.registry.components import component_of as component_of
from benchmark.registry.known import BUILT_IN as BUILT_IN
from benchmark.registry.known import SCORERS as SCORERS
from benchmark.registry.known import by_name as by_name
from benchmark.registry.selection import are_named as are_named
from benchmark.registry.selection import components_named as components_named
from benchmark.registry.selection import select as select
from benchmark.registry.selection import select_one as select_one
