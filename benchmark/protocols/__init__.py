"""What is tested on what, as data: tables, trainings, and the models that belong to them."""
